"""Trim with a segmenter of your own: any object with a name and a `segment` method will do.

This one calls red what is red; the scene is a red ball on a grey floor, and the coarse selection takes floor with it.
"""

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, BoolArray, Gaussians
from gaussian_trimmer.pipeline import TrimConfig, trim
from gaussian_trimmer.segmenters import View


class RedSegmenter:
    name = "red"

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        return [view.rgb[..., 0] > 2 * view.rgb[..., 1] for view in views]


rng = np.random.default_rng(0)
ball = rng.normal(size=(2000, 3))
ball *= 0.5 / np.linalg.norm(ball, axis=1, keepdims=True)
floor = rng.uniform([-2, 0.5, -2], [2, 0.52, 2], (6000, 3))  # y points down: the floor is under the ball.
means = np.concatenate([ball, floor]).astype(np.float32)
n = len(means)
colours = np.where(np.arange(n)[:, None] < len(ball), [0.9, 0.1, 0.1], [0.5, 0.5, 0.5])
scene = Gaussians(
    means,
    log_scales=np.full((n, 3), np.log(0.03), np.float32),
    quaternions=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
    opacity_logits=np.full(n, 3.0, np.float32),
    sh_dc=((colours - 0.5) / SH_C0).astype(np.float32),
    sh_rest=np.zeros((n, 3, 0), np.float32),
)
selection = np.linalg.norm(means, axis=1) < 0.7

result = trim(scene, selection, TrimConfig(), segmenter=RedSegmenter())
print(
    f"{np.count_nonzero(selection)} Gaussians selected, {len(result.object)} after trimming; the ball has {len(ball)}."
)
