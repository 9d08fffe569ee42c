"""Select by marks other than clicks: a file, a sphere that is taken away, and a step outwards; what each did."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.selecting.marks import FromFile, Grow, Mark, Sphere

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
x, y, z = np.median(scene.means[rough], axis=0)

marks: list[Mark] = [FromFile(sample.SELECTION), Sphere((x, y, z), 0.1, effect="remove"), Grow(1.0)]
for number in range(1, len(marks) + 1):
    selection = gt.select(scene, marks[:number], up="z")
    print(f"{selection.interpretations[-1]}: {np.count_nonzero(selection.mask)} of {len(scene)} Gaussians")
