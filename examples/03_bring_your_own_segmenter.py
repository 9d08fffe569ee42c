"""Trim with a segmenter of your own: any object with a name and a `segment` method will do.

This one believes the silhouette of the rough selection but near its edge, where OpenCV's watershed asks the picture.
"""

from collections.abc import Sequence

import cv2
import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.views.view import View


class WatershedSegmenter:
    name = "watershed"

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        masks = []
        for view in views:
            silhouette, near = (view.object_visible > 0.5).astype(np.uint8), np.ones((21, 21), np.uint8)
            inside, outside = cv2.erode(silhouette, near), 1 - cv2.dilate(silhouette, near)
            picture = (255 * view.rgb.clip(0, 1)).astype(np.uint8)
            masks.append(cv2.watershed(picture, (inside + 2 * outside).astype(np.int32)) == 1)
        return masks


scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
for segmenter in ("silhouette", WatershedSegmenter()):
    result = gt.trim(scene, rough, up="z", segmenter=segmenter)
    believed = sum(not view.rejected for view in result.objects[0].views)
    print(f"{result.segmenter}: {believed} masks believed, {result.object_mask.sum()} of {rough.sum()} Gaussians kept")
