"""The object's boundary Gaussians cut where they are too coarse, and fitted to soft coverage in many views.

A Gaussian that lies across the object's outline sticks out of the object if it stays as it was, and leaves it frayed if
it goes. So those of the object that show where they should not, or do not show where they should, are fitted until the
object alone shows the picture inside its coverage and nothing outside it. Those that are too large for that are cut in
two first. Nothing else is touched: inside its outline the object has the scene's own Gaussians, and so has the
background everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.fitting import Target, fit
from gaussian_trimmer.decomposition.soft_coverage import coverage_target
from gaussian_trimmer.decomposition.split_rules import split_plane
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate, rotation_matrices
from gaussian_trimmer.rendering.gradients import draw, weigh
from gaussian_trimmer.settings import Range, Share

_SHOWN = 0.02
"""Blend weight of a wrong pixel in each view, in pixels, from which on a Gaussian is worth the fit."""
_CUTS = 2
"""Times that a Gaussian may be cut in two."""
_RATE = 0.1
"""Length of the first step of a fit."""
_REFERENCE_PIXELS = 256 * 256
"""Pixels of a view for which thresholds on blend weights hold."""


@dataclass(frozen=True)
class RefineConfig:
    """How the object's boundary Gaussians are fitted to soft coverage, where `refine` is `fit`."""

    views: Annotated[int, Range(1, 1000)] = 16
    """Number of small views that they are fitted in."""
    size: Annotated[int, Range(16, 4096)] = 192
    """Width and height of these views in pixels."""
    steps: Annotated[int, Range(0, 10000)] = 32
    """Steps of the fit; each looks at two views."""
    wrong_share: Share = 0.02
    """Least share of a Gaussian's blend weight at pixels that are wrong, in the object alone, for it to be fitted."""
    cut_above: Annotated[float, Range(0, 1e6)] = 0.5
    """Blend weight at wrong pixels in each view, in pixels, above which a Gaussian is cut in two along its longest axis
    before the fit; its halves may be cut once more."""


@dataclass(frozen=True, eq=False)
class Refined:
    """An object of M Gaussians after the fit, and what it gave to the background."""

    object: Gaussians
    """Whole Gaussians in their order, then the parts of split ones."""
    parent: IntArray
    """Row of the object before the fit that each comes from, (M,)."""
    part: BoolArray
    """Which of them are parts of a Gaussian that was split, (M,)."""
    fitted: BoolArray
    """Which of them are not as they were, (M,)."""


def refine(
    inner: Gaussians,
    background: Gaussians,
    cameras: Sequence[Camera],
    masks: Sequence[FloatArray | None],
    radius: float,
    config: RefineConfig,
) -> Refined:
    """Fit the boundary of an object to its coverage in some views.

    Args:
        inner: the object's Gaussians.
        background: those around it.
        cameras: views to fit in.
        masks: coverage of the object in each view, (H, W), where it is known; else it follows from the two parts.
        radius: the object's radius in scene units.
        config: settings.
    """
    together = concatenate([inner, background])
    targets = [
        coverage_target(draw(together, camera), draw(inner, camera), len(inner), radius, mask)
        for camera, mask in zip(cameras, masks, strict=True)
    ]
    pieces, parent = inner, np.arange(len(inner))
    for _ in range(_CUTS):
        wrong = _wrong_weight(pieces, targets)
        coarse = _worth_it(wrong, len(targets), config) & (wrong[:, 0] > config.cut_above * len(targets))
        pieces, parent = _cut(pieces, parent, coarse)
    moving = _worth_it(_wrong_weight(pieces, targets), len(targets), config)
    pieces = _sound(fit(pieces, moving, targets, config.steps, _RATE), pieces)
    part = (np.bincount(parent, minlength=len(inner)) > 1)[parent]
    order = np.argsort(part, kind="stable")
    return Refined(pieces.select(order), parent[order], part[order], (moving | part)[order])


def _in_reference_pixels(camera: Camera) -> np.float32:
    return np.float32(_REFERENCE_PIXELS / (camera.width * camera.height))


def _wrong_weight(pieces: Gaussians, targets: Sequence[Target]) -> FloatArray:
    """Blend weight of each Gaussian, in pixels of views of 256 x 256: times what is wrong at a pixel, and all, (N, 2)."""
    total = np.zeros((len(pieces), 2), np.float32)
    for target in targets:
        drawing = draw(pieces, target.camera)
        wrong = np.abs(drawing.image[3] - target.picture[3]) * target.weight[3]
        total += weigh(drawing, np.stack([wrong, np.ones_like(wrong)])) * _in_reference_pixels(target.camera)
    return total


def _worth_it(wrong: FloatArray, views: int, config: RefineConfig) -> BoolArray:
    return np.asarray((wrong[:, 0] > config.wrong_share * wrong[:, 1]) & (wrong[:, 0] > _SHOWN * views))


def _cut(pieces: Gaussians, parent: IntArray, coarse: BoolArray) -> tuple[Gaussians, IntArray]:
    """The pieces, the coarse ones cut in two across their longest axes, and what each comes from."""
    if not coarse.any():
        return pieces, parent
    large = pieces.select(coarse)
    longest = np.argmax(large.log_scales, axis=1)
    axes = rotation_matrices(large.quaternions)[np.arange(len(large)), :, longest]
    halves = split_plane(large, axes, np.zeros(len(large)))
    again = parent[coarse]
    return concatenate([pieces.select(~coarse), *halves]), np.concatenate([parent[~coarse], again, again])


def _sound(fitted: Gaussians, before: Gaussians) -> Gaussians:
    """The fitted Gaussians, but those with a number that is none as they were before."""
    fields = ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc")
    good = np.ones(len(fitted), np.bool_)
    for name in fields:
        good &= ~np.isnan(getattr(fitted, name).reshape(len(fitted), -1)).any(axis=1)
    if good.all():
        return fitted
    return fitted.replace(**{
        name: np.where(good.reshape(-1, *[1] * (getattr(fitted, name).ndim - 1)), getattr(fitted, name), getattr(before, name))
        for name in fields
    })
