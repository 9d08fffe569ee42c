"""From the arrays of a trainer to a trimmed object and back, without a file: what a robot needs of it."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample

# Stands for the parameters of gsplat or of Inria's code; tensors, on any device, are taken as well.
arrays = gt.read(sample.SCENE).to_arrays(activated=True)
rough = np.load(sample.SELECTION)

scene = gt.Gaussians.from_arrays(**arrays)
result = gt.trim(scene, rough, up="z", views=3, config=gt.TrimConfig.of({"background": "exact", "refine": "off"}))

mine = result.object_mask  # (N,), over the rows of the arrays
print(f"{mine.sum()} of {len(mine)} rows are the object's; {'refused' if result.objects[0].refused else 'trimmed'}")
bounds = result.objects[0].bounds
print(
    f"centre {bounds.centre.round(2)}, size {(2 * bounds.half_extents).round(2)} along {bounds.axes.round(1).tolist()}"
)
back = result.object.to_arrays(activated=True)
print(f"opacities of {len(back['opacities'])} Gaussians from {back['opacities'].min():.2f}")
