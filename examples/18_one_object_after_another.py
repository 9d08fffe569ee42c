"""Cut objects out one after another: what the first one has stays out of the second."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
config = gt.TrimConfig.of({"refine": "off", "background": "exact", "plan.size": 256})

first = gt.trim(scene, rough, up="z", config=config)
around = np.linalg.norm(scene.means - first.objects[0].bounds.centre, axis=1) < 1.2 * first.objects[0].bounds.radius
second = gt.trim(scene, around & ~first.object_mask, up="z", config=config, excluded=first.object_mask)

shared = np.count_nonzero(first.object_mask & second.object_mask)
print(f"{first.object_mask.sum()} and {second.object_mask.sum()} Gaussians, {shared} in both")
