"""Trim with a renderer of your own: any object with the methods of `rendering.Renderer` will do.

This one inherits the built-in renderer and changes one method: it renders pictures at twice the size and averages
blocks of 2 x 2 pixels, for smoother edges in what the segmenter sees.
"""

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians
from gaussian_trimmer.pipeline import TrimConfig, trim
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.rendering.numba_cpu import NumbaRenderer


class SupersamplingRenderer(NumbaRenderer):
    name = "supersampling"

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        fine = super().render(gaussians, camera.resized(2), background, weights)
        rgb = fine.rgb.reshape(camera.height, 2, camera.width, 2, 3).mean(axis=(1, 3))
        alpha, depth_times_alpha = (
            image.reshape(camera.height, 2, camera.width, 2).mean(axis=(1, 3))
            for image in (fine.alpha, fine.depth * fine.alpha)
        )
        depth = np.divide(depth_times_alpha, alpha, out=np.zeros_like(alpha), where=alpha > 0)
        return Rendering(rgb, alpha, depth, fine.weights / np.float32(4))


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

result = trim(scene, selection, TrimConfig(), renderer=SupersamplingRenderer())
print(
    f"{np.count_nonzero(selection)} Gaussians selected, {len(result.object)} after trimming; the ball has {len(ball)}."
)
