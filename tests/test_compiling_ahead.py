"""What is compiled ahead is what a trim calls: kernels compiled for other types would be compiled twice."""

import numba
import numpy as np
import pytest
from scenes import front_camera, random_scene

from gaussian_trimmer.rendering import gradient_kernels
from gaussian_trimmer.rendering.gradients import compile_kernels, draw, gradients, loss_gradient

KERNELS = [
    gradient_kernels.huber_gradient, gradient_kernels.differentiate_tiles, gradient_kernels.sum_moving_pairs,
    gradient_kernels.gather,
]  # fmt: skip


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set, so nothing is compiled.")
def test_every_kernel_is_compiled_for_the_types_that_it_is_called_with():
    compile_kernels()
    before = [kernel.signatures for kernel in KERNELS]
    scene, camera = random_scene(0, 40), front_camera(48, 32)
    drawing = draw(scene, camera)
    picture = np.zeros((4, 32, 48), np.float32)
    gradients(drawing, loss_gradient(drawing, picture, picture + 1, 0.1), np.ones(len(scene), np.bool_))
    assert all(before)
    assert [kernel.signatures for kernel in KERNELS] == before
