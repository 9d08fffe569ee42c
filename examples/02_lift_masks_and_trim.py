"""From masks of photographs to a trimmed object: lift the masks to a rough selection, then trim that.

The ten masks are those of the lighthouse in some of the pictures that the sample scene was trained with; on the command
line the first half is `gaussian-trimmer select --masks`.
"""

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.masks.mask_files import read_masks
from gaussian_trimmer.selecting.lifting import lift_by_assignment

scene = gt.read(sample.SCENE)
cameras = gt.read_cameras(sample.CAMERAS)

pairs = read_masks(sample.MASKS, cameras)  # cameras, each with its mask
rough = lift_by_assignment(scene, [camera for camera, _ in pairs], [mask for _, mask in pairs])
print(f"{rough.sum()} of {len(scene)} Gaussians lifted from {len(pairs)} masks")

result = gt.trim(scene, rough, cameras=cameras)
print(f"virtual views: {result.object_mask.sum()} Gaussians in the object")

# The masks themselves may take the place of virtual views.
result = gt.trim(scene, rough, masks=pairs, cameras=cameras)
print(f"the masks' own views: {result.object_mask.sum()} Gaussians in the object")
