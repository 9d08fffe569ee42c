"""Trim by masks of your own, drawn in the views that a trim would look from.

These believe the silhouette of the rough selection but near its edge, where OpenCV's watershed asks the picture.
"""

import cv2
import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.trimming.trim import views_to_segment
from gaussian_trimmer.views.view import View


def watershed(view: View) -> BoolArray:
    silhouette, near = (view.object_visible > 0.5).astype(np.uint8), np.ones((21, 21), np.uint8)
    inside, outside = cv2.erode(silhouette, near), 1 - cv2.dilate(silhouette, near)
    picture = (255 * view.rgb.clip(0, 1)).astype(np.uint8)
    return np.asarray(cv2.watershed(picture, (inside + 2 * outside).astype(np.int32)) == 1)


scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
views, _ = views_to_segment(scene, rough, up="z")
for name, masks in (("silhouettes", None), ("watershed", [(view.camera, watershed(view)) for view in views])):
    result = gt.trim(scene, rough, up="z", masks=masks)
    believed = sum(not view.rejected for view in result.objects[0].views)
    print(f"{name}: {believed} masks believed, {result.object_mask.sum()} of {rough.sum()} Gaussians kept")
