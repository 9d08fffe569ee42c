"""Lifting of 2D labels to Gaussians: what each contributes to the pixels of each label."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_weights

UNDECIDED = np.float32(0.5)
"""Share inside the masks, and probability, that speak neither for the object nor against it."""


def label_weights(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    labels: Iterable[NDArray[np.uint8] | BoolArray],
    n_labels: int = 2,
) -> Iterator[FloatArray]:
    """Blend weights of each Gaussian summed over the pixels of each label, (N, n_labels), one array a view.

    Args:
        gaussians: what the views show, N Gaussians.
        cameras: the cameras of the views.
        labels: the label of each pixel, (H, W) each; of a mask, 0 outside and 1 inside.
        n_labels: how many labels there are; pixels of higher ones are left out.
    """

    def weights(camera: Camera, image: NDArray[np.uint8] | BoolArray) -> FloatArray:
        return blend_weights(gaussians, camera, image.astype(np.uint8), n_labels)

    return parallel_map(weights, cameras, labels)


def share_inside(weights: FloatArray, min_weight: float = 0.0) -> FloatArray:
    """Return the share of the blend weights outside and inside of masks (N, 2) that is inside, (N,).

    It is one half where there is no more weight than `min_weight`.
    """
    total = weights.sum(axis=1)
    share = np.full_like(total, UNDECIDED)
    return np.asarray(np.divide(weights[:, 1], total, out=share, where=total > min_weight))
