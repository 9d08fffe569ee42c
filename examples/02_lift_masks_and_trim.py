"""From masks of photographs to a trimmed object: lift the masks to a rough selection, then trim that.

The ten masks are those of the lighthouse in some of the pictures that the sample scene was trained with; on the command
line the first half is `gaussian-trimmer select --masks`.
"""

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.masks.mask_files import (
    MaskFilesConfig,
    MaskFilesSegmenter,
    cameras_with_masks,
    mask_of,
)
from gaussian_trimmer.selecting.lifting import lift_by_assignment

scene = gt.read(sample.SCENE)
cameras = gt.read_cameras(sample.CAMERAS)

training_cameras = cameras_with_masks(cameras.pinhole_cameras(), sample.MASKS)
masks = [mask_of(camera, sample.MASKS) for camera in training_cameras]
rough = lift_by_assignment(scene, training_cameras, masks)
print(f"{rough.sum()} of {len(scene)} Gaussians lifted from {len(masks)} masks")

result = gt.trim(scene, rough, cameras=cameras)
print(f"virtual views: {result.object_mask.sum()} Gaussians in the object")

# The masks themselves may stand in for the segmented virtual views.
by_masks = MaskFilesSegmenter(MaskFilesConfig(sample.MASKS))
result = gt.trim(scene, rough, segmenter=by_masks, cameras=cameras, view_cameras=training_cameras)
print(f"the masks' own views: {result.object_mask.sum()} Gaussians in the object")
