"""What is seen around a place, and how firmly each Gaussian hangs together with those beside it.

Gaussians are seen from all around the place, and those that show form a surface: each has a colour, a side that it
turns to who looks at it, and neighbours. Two neighbours belong together the more they are alike in colour and the less
the surface folds inwards between them: things that touch, and the parts of things, meet in grooves.

The fold as a sign of where parts meet is that of "Object Partitioning using Local Convexity" (Stein et al., CVPR 2014).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.min_cut import min_cut
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.view_rendering import visible_weight

REACH = 3.0
"""How far around the place Gaussians are looked at, in radii."""
_RINGS = ((5.0, 8), (35.0, 8), (65.0, 4))
"""Pitch in degrees and number of views of each ring."""
_SEEN_WITHIN = np.cos(np.radians(50))
"""Views farther than this from the direction of every training camera show what nobody photographed."""
_SIZE, _FOV, _DISTANCE = 256, np.radians(60), 4.0
"""Size in pixels, field of view and distance in radii of the views."""
_REFERENCE_RADIUS = 64.0
"""The radius in pixels that the first view's weights are counted at, whatever its own size."""
_LEAST_VISIBLE, _SHOWN_FIRST = 0.5, 0.3
"""Pixels that a Gaussian must show in all views to be surface, and in the first one to be judged by it."""
_MOST = 15_000
"""Gaussians of the surface; the others follow the nearest of them."""
_NEIGHBOURS, _AROUND = 10, 17
"""Neighbours that a Gaussian hangs together with, and those that its colour and side are found with."""
_ALIKE = 10.0
"""Difference of colours in Lab (lightness halved) at which a bond is weak."""
_FOLD = 0.3
"""Fold inwards at which a bond is weak, as the sum of the sines of both sides' slopes."""
_WEAKEST = 0.05
"""What is left of a bond however unlike its ends are: small spots of another colour stay with what is around them."""
_ROUGH = 0.5
"""Bond where the surface is too rough to have a side."""
_BINS = (20, 26, 26)
"""Bins of the colour models in L, a and b."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The S of a scene's N Gaussians that are seen around a place."""

    rows: IntArray
    """Their rows in the scene, (S,)."""
    hidden: IntArray
    """Rows of other Gaussians there, which hardly show, (H,)."""
    places: FloatArray
    """Their centres, (S, 3)."""
    colours: FloatArray
    """Their colours in Lab, smoothed along the surface, (S, 3)."""
    areas: Float64Array
    """The area that each stands for, in squared radii, (S,)."""
    in_first: BoolArray
    """Which of them the first view shows, (S,)."""
    pairs: IntArray
    """Neighbours, each pair once, (E, 2)."""
    bonds: Float64Array
    """What it costs to part each pair: the length of boundary between them, in radii, less where a boundary is seen."""
    lengths: Float64Array
    """The length of boundary between each pair, in radii, (E,)."""
    radius: float
    """The unit of length."""
    centre: Float64Array
    """The place, (3,)."""

    def divide(self, pulls: Float64Array) -> BoolArray:
        """The cheapest division that respects how much each is drawn to the object, (S,); see `min_cut`."""
        fixed = np.isneginf(pulls)
        free = np.flatnonzero(~fixed)
        numbers = np.full(len(pulls), -1)
        numbers[free] = np.arange(len(free))
        inside = ~fixed[self.pairs]
        both, across = inside.all(axis=1), inside.any(axis=1) & ~inside.all(axis=1)
        pulls = pulls.copy()
        ends = np.where(inside[across, 0], self.pairs[across, 0], self.pairs[across, 1])
        pulls -= np.bincount(ends, self.bonds[across], len(pulls))
        found = np.zeros(len(pulls), np.bool_)
        found[free] = min_cut(pulls[free], numbers[self.pairs[both]], self.bonds[both])
        return found

    def boundary(self, part: BoolArray) -> tuple[float, float]:
        """What it costs to part these from the others, and the length of that boundary in radii."""
        cut = part[self.pairs[:, 0]] != part[self.pairs[:, 1]]
        return float(self.bonds[cut].sum()), float(self.lengths[cut].sum())

    def colour_evidence(self, part: BoolArray) -> tuple[Float64Array, float]:
        """How much likelier each colour is in a part (S,) than beside it, as a log-ratio in [-2, 2], (S,).

        The second value is the mean share of either side that the colours tell right, 0.5 if they tell nothing.
        """
        offsets, steps = np.array([0, 128, 128]), np.array([100 / 16, 10, 10])
        bins = np.clip((self.colours + offsets) / steps, 0, np.array(_BINS) - 1).astype(np.int64)
        flat = np.ravel_multi_index(tuple(bins.T), _BINS)
        inside, beside = self.areas * part, self.areas * ~part
        models = [_histogram(flat, weights) for weights in (inside, beside)]
        ratio = np.log((models[0] + 1e-4) / (models[1] + 1e-4))[flat]
        right = [
            float(weights @ agrees / max(weights.sum(), 1e-12))
            for weights, agrees in ((inside, ratio > 0), (beside, ratio < 0))
        ]
        return np.clip(ratio, -2, 2), sum(right) / 2

    def with_hidden(self, gaussians: Gaussians, part: BoolArray, allowed: BoolArray) -> BoolArray:
        """A part of the surface (S,) and what lies hidden next to it, (N,); hidden ones must be allowed, (N,)."""
        chosen = np.zeros(len(gaussians), np.bool_)
        chosen[self.rows[part]] = True
        rows = self.hidden[allowed[self.hidden]]
        if len(rows):
            squared, near = nearest(self.places, gaussians.means[rows], min(4, len(self.places)))
            inside = (part[near].mean(axis=1) > 0.5) & (squared[:, 0] < (0.5 * self.radius) ** 2)
            chosen[rows[inside]] = True
        return chosen


def look_around(
    gaussians: Gaussians, camera: Camera, centre: Float64Array, radius: float, wanted: BoolArray, up: Float64Array,
    renderer: Renderer, seen_from: Sequence[Camera] = (), reach: float = 1.0,
) -> Surface:  # fmt: skip
    """The surface around a place, seen from a view and from all around.

    Args:
        camera: the first view.
        centre: the place, (3,).
        radius: about half the size of what is there, in scene units.
        wanted: which Gaussians may be part of the surface, (N,).
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: only views near to theirs are used.
        reach: factor by which more of the surroundings is looked at.
    """
    near = np.flatnonzero(np.linalg.norm(gaussians.means - centre, axis=1) < REACH * reach * radius)
    local = gaussians.select(near)
    views = _views_around(camera, centre, reach * radius, up, seen_from)
    weights = [renderer.blend_weights(local, view, _no_labels(view), 1)[:, 0] for view in views]
    pixels = radius * camera.K[0, 0] / float(np.linalg.norm(camera.centre - centre))
    first = renderer.blend_weights(gaussians, camera, _no_labels(camera), 1)[near, 0]
    first = first * np.float32((_REFERENCE_RADIUS / pixels) ** 2)
    around = visible_weight(weights, views) if views else np.zeros(len(near), np.float32)
    visible = around + first
    shown = wanted[near] & (visible > _LEAST_VISIBLE)
    if np.count_nonzero(shown) > _MOST:
        shown &= visible >= np.partition(visible[shown], -_MOST)[-_MOST]
    facing = sum(
        (weight[shown, None] * _directions(local.means[shown], view.centre))
        for weight, view in zip([*weights, first], [*views, camera], strict=True)
    )
    return _build(local, near, shown, visible, first > _SHOWN_FIRST, np.asarray(facing), radius, centre)


def _build(
    local: Gaussians, near: IntArray, shown: BoolArray, visible: FloatArray, in_first: BoolArray, facing: FloatArray,
    radius: float, centre: Float64Array,
) -> Surface:  # fmt: skip
    """The surface of those local Gaussians that are shown."""
    places = local.means[shown]
    squared, beside = nearest(places, places, min(_AROUND, len(places)))
    distance = np.sqrt(squared)
    middle = distance.shape[1] // 2
    weights = np.minimum(visible[shown], 20)[beside] * np.exp(-0.5 * squared / np.maximum(squared[:, [middle]], 1e-30))
    colours = _smooth_colours(np.clip(0.5 + SH_C0 * local.sh_dc[shown], 0, 1), beside, weights)
    normals, flatness = _sides(places, beside, weights, facing)
    spacing = distance[:, distance.shape[1] // 4]

    k = min(_NEIGHBOURS, len(places) - 1)
    keys = np.repeat(np.arange(len(places)), k), beside[:, 1 : k + 1].ravel().astype(np.int64)
    ends = np.stack([np.minimum(*keys), np.maximum(*keys)], axis=1)
    _, once, twice = np.unique(ends[:, 0] * len(places) + ends[:, 1], return_index=True, return_counts=True)
    pairs, apart = ends[once], distance[:, 1 : k + 1].ravel()[once]
    a, b = pairs.T
    width = np.sqrt(spacing[a] * spacing[b])
    length = np.exp(-0.5 * (apart / np.maximum(1.5 * width, 1e-30)) ** 2) * width / radius * (2 * twice / k)
    unlike = np.square((colours[a] - colours[b]) * [0.5**0.5, 1, 1]).sum(axis=1)
    step = (places[b] - places[a]) / np.maximum(apart, 1e-30)[:, None]
    fold = np.einsum("ei,ei->e", normals[a] - normals[b], step)
    flat = np.minimum(flatness[a], flatness[b])
    smooth = flat * np.exp(-np.maximum(fold, 0) / _FOLD) + (1 - flat) * _ROUGH
    firm = _WEAKEST + (1 - _WEAKEST) * np.exp(-0.5 * unlike / _ALIKE**2) * smooth
    return Surface(
        near[shown], near[~shown], places, colours, np.square(spacing / radius).astype(np.float64), in_first[shown],
        pairs, (length * firm).astype(np.float64), length.astype(np.float64), radius, centre,
    )  # fmt: skip


def _views_around(
    camera: Camera, centre: Float64Array, radius: float, up: Float64Array, seen_from: Sequence[Camera]
) -> list[Camera]:
    """Small views from all around a place, the first of each ring from the camera's side."""
    axes = up_frame(up)
    offset = axes @ (camera.centre - centre)
    K = intrinsics(_FOV, _SIZE, _SIZE)
    outwards = []
    for pitch, number in _RINGS:
        yaws = np.arctan2(offset[1], offset[0]) + 2 * np.pi * np.arange(number) / number
        level, rise = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
        outwards += [np.array([np.cos(yaw) * level, np.sin(yaw) * level, rise]) @ axes for yaw in yaws]
    known = _directions(np.broadcast_to(centre, (len(seen_from), 3)), np.array([c.centre for c in seen_from]))
    chosen = [way for way in outwards if not len(known) or (known @ way).max() > _SEEN_WITHIN]
    poses = [look_at(centre + _DISTANCE * radius * way, centre, axes[2]) for way in chosen]
    return [Camera(pose, K, _SIZE, _SIZE, near=0.01 * radius) for pose in poses]


def _directions(points: NDArray[np.floating], target: Float64Array) -> FloatArray:
    """Unit vectors from points (P, 3) to a target (3,) or targets (P, 3)."""
    offset = np.asarray(target - points, np.float32).reshape(-1, 3)
    return np.asarray(offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-30))


def _smooth_colours(rgb: FloatArray, beside: NDArray[np.int32], weights: FloatArray) -> FloatArray:
    """Lab colours, averaged over neighbours that are alike, twice, (S, 3)."""
    lab = np.asarray(cv2.cvtColor(rgb.astype(np.float32)[None], cv2.COLOR_RGB2Lab)[0])
    for _ in range(2):
        alike = weights * np.exp(-0.5 * np.square(lab[beside] - lab[:, None]).sum(axis=2) / (2 * _ALIKE) ** 2)
        lab = np.einsum("sk,ski->si", alike, lab[beside]) / np.maximum(alike.sum(axis=1, keepdims=True), 1e-30)
    return np.asarray(lab, np.float32)


def _sides(
    places: FloatArray, beside: NDArray[np.int32], weights: FloatArray, facing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unit normals (S, 3) of the surface, turned to those who see it, and how flat it is, 0 to 1, (S,)."""
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-30)
    around = places[beside]
    offsets = around - np.einsum("sk,ski->si", shares, around)[:, None]
    spread, axes = np.linalg.eigh(np.einsum("sk,ski,skj->sij", shares, offsets, offsets))
    normals = axes[:, :, 0]
    normals = normals * np.where(np.einsum("si,si->s", normals, facing) < 0, -1, 1)[:, None]
    flatness = 1 - spread[:, 0] / np.maximum(spread[:, 1], 1e-30)
    return np.asarray(normals, np.float32), np.asarray(np.clip(flatness, 0, 1), np.float32)


def _histogram(bins: IntArray, weights: Float64Array) -> Float64Array:
    """Normalised colour histogram, blurred by a bin, flat."""
    counts = np.bincount(bins, weights, int(np.prod(_BINS))).reshape(_BINS)
    for axis in range(3):
        lined = np.pad(np.moveaxis(counts, axis, 0), ((1, 1), (0, 0), (0, 0)))
        counts = np.moveaxis(0.25 * lined[:-2] + 0.5 * lined[1:-1] + 0.25 * lined[2:], 0, axis)
    return np.asarray((counts / max(counts.sum(), 1e-12)).ravel())


def _no_labels(camera: Camera) -> NDArray[np.uint8]:
    return np.zeros((camera.height, camera.width), np.uint8)
