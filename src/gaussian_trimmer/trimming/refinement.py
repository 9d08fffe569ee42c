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

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate, rotation_matrices
from gaussian_trimmer.geometry.split import split_plane
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.trimming.alpha_targets import ObjectRenders, coverage_targets, thin_share
from gaussian_trimmer.trimming.fitting import Target, fit

_MAX_CUTS = 5
"""Times that a Gaussian may be cut in two."""
_FIRST_STEP = 0.1
"""Length of the first step of a fit."""
_REFERENCE_PIXELS = 256 * 256
"""Pixels of a view for which thresholds on blend weights hold."""


@dataclass(frozen=True)
class RefineConfig:
    """How the object's boundary Gaussians are fitted to soft coverage, where `refine` is `fit`."""

    views: Annotated[int, Range(1, 1000)] = 12
    """Number of small views that they are fitted in, and in which it is found what is out of place. Of views of given
    cameras, all are."""
    size: Annotated[int, Range(16, 4096)] = 192
    """Width and height in pixels of these views, and of those in which the scene without the object is made."""
    steps: Annotated[int, Range(0, 10000)] = 32
    """Steps of the fit; each looks at two views."""
    wrong_share: Share = 0.02
    """Least share of a Gaussian's blend weight at pixels that are wrong, in the object alone, for it to be fitted."""
    max_thin: Share = 0.035
    """Largest share of the object that may be less than three pixels wide in these views, where no masks are known. If
    more is, coverage that follows from labels makes leaves and wires thinner, so nothing is fitted."""
    cut_above: Annotated[float, Range(0, 1e6)] = 0.5
    """Blend weight at wrong pixels in each view, in pixels, above which a Gaussian is cut in two along its longest axis
    before the fit, and so are its halves."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """M Gaussians of an object, or cut off from it: whole ones, and parts of those that were cut."""

    gaussians: Gaussians
    source: IntArray
    """Scene row that each comes from, (M,)."""
    part: BoolArray
    """Which of them are parts, (M,)."""
    fitted: BoolArray
    """Which of them a fit cut or changed, (M,)."""

    @classmethod
    def of(cls, gaussians: Gaussians, source: IntArray, *, part: bool = False) -> Pieces:
        """Return Gaussians that no fit has touched, all of them whole or all of them parts."""
        return cls(gaussians, source, np.full(len(source), part), np.zeros(len(source), np.bool_))

    def select(self, rows: IntArray) -> Pieces:
        """Return those with some row numbers."""
        return Pieces(self.gaussians.select(rows), self.source[rows], self.part[rows], self.fitted[rows])

    def parts(self, gaussians: Gaussians) -> Pieces:
        """Return one part of each."""
        return Pieces(gaussians, self.source, np.ones_like(self.part), self.fitted)

    def followed_by(self, other: Pieces) -> Pieces:
        """Return these and others after them."""
        return Pieces(
            concatenate([self.gaussians, other.gaussians]),
            np.concatenate([self.source, other.source]),
            np.concatenate([self.part, other.part]),
            np.concatenate([self.fitted, other.fitted]),
        )


def refine(whole: Pieces, renders: ObjectRenders, config: RefineConfig) -> tuple[Pieces, str | None]:
    """Fit the boundary of an object to its coverage in some views.

    Args:
        whole: the object's Gaussians.
        renders: views of it alone and among those around it, in colour, to fit in.
        config: settings.

    Returns:
        The object, with the Gaussians that were cut in the fit after all others, and why nothing was fitted; None if it
        was.
    """
    inner = whole.gaussians
    thin = thin_share(renders.alone.alpha) if renders.masks is None else 0.0
    if thin > config.max_thin:
        limit = f"the limit is {100 * config.max_thin:g} %"
        return whole, f"{100 * thin:.1f} % of the object is thinner than three pixels; {limit}"
    targets = coverage_targets(renders)
    wrong = np.sum(_wrong_weight(renders, targets), axis=0)
    is_boundary = np.asarray(wrong[:, 0] > config.wrong_share * wrong[:, 1])
    pieces, parent = inner, np.arange(len(inner))
    each = np.where(is_boundary, wrong[:, 0], 0) / len(targets)
    for _ in range(_MAX_CUTS):
        pieces, parent = _cut(pieces, parent, (each > config.cut_above)[parent])
        each = np.where(each > config.cut_above, each / 2, 0)  # each half carries half of the error
    moving = is_boundary[parent]
    widths = np.exp(inner.largest_log_scales[parent] - pieces.largest_log_scales)
    siblings = np.bincount(parent)[parent]
    pieces = fit(pieces, moving, targets, config.steps, _FIRST_STEP, widths, siblings)
    cut = siblings > 1
    order = np.argsort(cut, kind="stable")
    source, part = whole.source[parent], whole.part[parent] | cut
    return Pieces(pieces.select(order), source[order], part[order], (moving | cut)[order]), None


def _wrong_weight(renders: ObjectRenders, targets: Sequence[Target]) -> FloatArray:
    """Return blend weight at wrong pixels and in all, in pixels of views of 256 x 256, (V, M, 2)."""
    wrong = [np.abs(alpha - t.picture[3]) * t.weight[3] for alpha, t in zip(renders.alone.alpha, targets, strict=True)]
    scales = [_REFERENCE_PIXELS / (camera.width * camera.height) for camera in renders.alone.cameras]
    weights = renders.weigh_alone([np.stack([image, np.ones_like(image)]) for image in wrong])
    return weights * np.array(scales, np.float32)[:, None, None]


def _cut(pieces: Gaussians, parent: IntArray, coarse: BoolArray) -> tuple[Gaussians, IntArray]:
    """Return the pieces, the coarse ones cut in two across their longest axes, and what each comes from."""
    if not coarse.any():
        return pieces, parent
    large = pieces.select(coarse)
    longest = np.argmax(large.log_scales, axis=1)
    axes = rotation_matrices(large.quaternions)[np.arange(len(large)), :, longest]
    halves = split_plane(large, axes, np.zeros(len(large)))
    again = parent[coarse]
    return concatenate([pieces.select(~coarse), *halves]), np.concatenate([parent[~coarse], again, again])
