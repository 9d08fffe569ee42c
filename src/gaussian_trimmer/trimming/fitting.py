"""Gaussians fitted to pictures by gradient steps, with a prior towards the start: place, shape, opacity and colour.

The parameters of a Gaussian are what it is changed by, in its own measure: a move in standard deviations along its own
axes (of the whole Gaussian, if it is a part of one), logarithms of factors of its scales, a turn about its own axes, a
difference of its opacity logit and of its constant colour. All are zero at the start, so that a weight on their squares
keeps what the pictures do not show: as much as the pixels of one view count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, rotation_matrices
from gaussian_trimmer.rendering.gradient_kernels import N_PARAMETERS
from gaussian_trimmer.rendering.gradients import gradients, loss_gradient
from gaussian_trimmer.rendering.projection import as_tiles
from gaussian_trimmer.rendering.tile_renderer import draw

_VIEWS_PER_STEP = 2
_HUBER_DELTA = 0.1
"""Difference at a pixel beyond which it counts in proportion rather than by its square, so that pixels that no Gaussian
can mend do not govern the fit."""
_MEAN_DECAY, _SQUARE_DECAY, _LEAST_LENGTH = 0.9, 0.999, 1e-8
"""Decay rates of Adam for the mean gradient and its square, and what keeps it from dividing by zero."""
_MAX_GRADIENT = np.float32(1e9)
"""Gradients are clipped here, so that their squares, and with them every step, are finite."""


@dataclass(frozen=True, eq=False)
class Target:
    """What a view should show."""

    camera: Camera
    picture: FloatArray
    """Colour, premultiplied by alpha, and alpha, (4, H, W)."""
    weight: FloatArray
    """How much each value of it counts, (4, H, W)."""


def fit(
    gaussians: Gaussians,
    moving: BoolArray,
    targets: Sequence[Target],
    steps: int,
    rate: float,
    step_scale: FloatArray | float = 1.0,
    siblings: IntArray | int = 1,
) -> Gaussians:
    """Return the Gaussians, of which some are changed so that they show what they should.

    Adam (Kingma and Ba, 2015) on the sum over pixels of sqrt(difference^2 + 0.1^2), two views a step. Its steps shrink
    evenly to nothing, so that few parameters move more than half of `steps * rate`, the sum of their lengths.

    Args:
        gaussians: all that the views show, N of them.
        moving: which of them may change, (N,).
        targets: what they should show.
        steps: number of steps.
        rate: length of the first step, in the units of the parameters.
        step_scale: factor of the steps of each, (N,): how much wider the whole is that it was cut from.
        siblings: number of parts that this whole has, (N,): together they weigh as much as the whole.
    """
    rows = np.flatnonzero(moving)
    if not len(rows) or not targets:
        return gaussians
    axes = rotation_matrices(gaussians.quaternions[rows]).astype(np.float32)
    scale, count = np.broadcast_to(step_scale, len(gaussians)), np.broadcast_to(siblings, len(gaussians))
    axes *= (scale[rows, None] * np.exp(gaussians.log_scales[rows]))[:, None, :]
    prior = (1 / count[rows, None]).astype(np.float32)
    change = np.zeros((len(rows), N_PARAMETERS), np.float32)
    mean, square = np.zeros_like(change), np.zeros_like(change)
    order = golden_ratio_order(len(targets))
    current = gaussians

    @cache
    def wanted(*seen: int) -> tuple[FloatArray, FloatArray]:
        """Return pictures of some views, and how much each of their values counts, (4, T, A) each."""
        pictures, weights = [as_tiles(targets[v].picture) for v in seen], [as_tiles(targets[v].weight) for v in seen]
        return np.concatenate(pictures, axis=1), np.concatenate(weights, axis=1)

    for step in range(steps):
        seen = [order[(_VIEWS_PER_STEP * step + k) % len(order)] for k in range(_VIEWS_PER_STEP)]
        drawing = draw(current, [targets[view].camera for view in seen], around=moving)
        slopes = loss_gradient(drawing, *wanted(*seen), _HUBER_DELTA)
        gradient = gradients(drawing, slopes, moving).sum(axis=0) / _VIEWS_PER_STEP
        gradient[:, :3] = np.einsum("nij,ni->nj", axes, gradient[:, :3])
        gradient = np.nan_to_num(gradient, nan=0.0).clip(-_MAX_GRADIENT, _MAX_GRADIENT)
        gradient += prior * change
        mean = _MEAN_DECAY * mean + (1 - _MEAN_DECAY) * gradient
        square = _SQUARE_DECAY * square + (1 - _SQUARE_DECAY) * gradient**2
        direction = mean / (1 - _MEAN_DECAY ** (step + 1))
        length = np.sqrt(square / (1 - _SQUARE_DECAY ** (step + 1))) + np.float32(_LEAST_LENGTH)
        change -= np.float32(rate * (1 - step / steps)) * direction / length
        current = changed(gaussians, rows, change, axes)
    return current


def changed(gaussians: Gaussians, rows: IntArray, change: FloatArray, axes: FloatArray) -> Gaussians:
    """Return the Gaussians with some rows changed by parameters (K, 13); `axes` are their scaled axes, (K, 3, 3)."""
    means, log_scales, quaternions = gaussians.means.copy(), gaussians.log_scales.copy(), gaussians.quaternions.copy()
    logits, colours = gaussians.opacity_logits.copy(), gaussians.sh_dc.copy()
    means[rows] += np.einsum("nij,nj->ni", axes, change[:, :3])
    log_scales[rows] += change[:, 3:6]
    quaternions[rows] = _turned(quaternions[rows], change[:, 6:9])
    logits[rows] += change[:, 9]
    colours[rows] += change[:, 10:]
    return gaussians.replace(
        means=means, log_scales=log_scales, quaternions=quaternions, opacity_logits=logits, sh_dc=colours
    )


def _turned(quaternions: FloatArray, turns: FloatArray) -> FloatArray:
    """Return rotations (K, 4) after a turn about their own axes, by rotation vectors (K, 3); of unit length."""
    q = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    sines = turns * np.divide(np.sin(angles / 2), angles, out=np.full_like(angles, 0.5), where=angles > 1e-6)
    w, v, cosines = q[:, :1], q[:, 1:], np.cos(angles / 2)
    real = w * cosines - np.sum(v * sines, axis=1, keepdims=True)
    return np.asarray(np.concatenate([real, w * sines + cosines * v + np.cross(v, sines)], axis=1), np.float32)


def golden_ratio_order(n: int) -> list[int]:
    """Return 0 to n - 1 in steps of the golden ratio, so that neighbours are far from each other."""
    stride = max(1, round(0.618 * n))
    while np.gcd(stride, n) != 1:
        stride += 1
    return [i * stride % n for i in range(n)]
