"""Paints a snapshot: which Gaussians are shown, in which colours. N Gaussians of the scene, M shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.app.snapshots import MarkedObject, Snapshot
from gaussian_trimmer.app.viewpoints import Frame, Part, Showing
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering.blending import view_colours
from gaussian_trimmer.trimming.result import RowLabel, TrimResult

_TINT_SHARE = 0.6
"""Share of the object's colour in that of a selected Gaussian."""
_GHOST_SHARE = np.float32(0.15)
"""Share of the opacity of what is a ghost."""
REMOVED, ADDED, CUT, MADE_UP = (222, 60, 40), (20, 180, 100), (60, 130, 230), (245, 225, 60)
"""Colours of changes."""
_MADE_UP, _PART_OUTSIDE = -1, -2
"""In place of a row of the scene: of a Gaussian that is new, and of the outer part of a split one."""

_BESIDE_PICTURE = 0.05
"""How much what lies outside the picture counts; it is there when the view turns, until it is refined."""
_PICTURE_MARGIN = 0.1
"""What counts as the picture, beyond its edges, relative to its size."""
_NEAREST = 0.05
"""Distance below which all counts the same, relative to the median distance."""
_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Splats:
    """M Gaussians as a viewer draws them, from one side."""

    centres: FloatArray
    """In the viewer's coordinates, (M, 3)."""
    covariances: FloatArray
    """(M, 3, 3)."""
    colours: FloatArray
    """RGB from 0 to 1, (M, 3)."""
    opacities: FloatArray
    """(M, 1)."""
    rows: IntArray
    """Rows of the scene that they come from, below zero for none, (M,)."""

    def __len__(self) -> int:
        return len(self.centres)


class Painter:
    """Draws states of one scene. What it keeps is bounded by the number of Gaussians that are shown at most."""

    def __init__(self, scene: Gaussians, most: int) -> None:
        """Prepare a scene, which is thinned if it has more Gaussians than `most`."""
        self.scene = scene
        self.frame = Frame.around(scene.means)
        self.most = most
        self._last: tuple[IntArray, FloatArray, Splats] | None = None

    @property
    def depends_on_eye(self) -> bool:
        """Whether the scene looks different from elsewhere, by its colours or by what there is room for."""
        return self.scene.sh_degree > 0 or len(self.scene) > self.most

    def paint(self, now: Snapshot, showing: Showing, eye: Camera | None = None) -> Splats:
        """Return the Gaussians to show of a state, in their colours.

        Args:
            now: the state.
            showing: what of it is to be seen.
            eye: the camera that it is shown to; what is near it is not thinned.
        """
        after = showing.when == "Cut-out"
        visible = shown_rows(now, showing) & ~_replaced_rows(now, after)
        splats = self._splats(visible, eye)
        if after:
            splats = _joined([splats, *self._replacements(now, showing.part, eye)])
        if showing.colours == "Objects":
            owner = np.where(splats.rows >= 0, _owners(now, after)[splats.rows], -1)
            tints = [(owner == place, marked.colour) for place, marked in enumerate(now.objects)]
        else:
            tints = list(_changes(now, splats)) if showing.colours == "Changes" else []
        colours, opacities = splats.colours.copy(), splats.opacities
        if showing.ghost:
            rest = (splats.rows >= 0) & (_owners(now, after)[splats.rows] != now.active)
            colours[rest], opacities = 0.5, np.where(rest[:, None], _GHOST_SHARE * opacities, opacities)
        for mine, colour in tints:
            colours[mine] = (1 - _TINT_SHARE) * colours[mine] + _TINT_SHARE * np.array(colour, np.float32) / 255
        return replace(splats, colours=colours, opacities=opacities)

    def _splats(self, visible: BoolArray, eye: Camera | None) -> Splats:
        """Return what is shown of the visible Gaussians of the scene, (N,)."""
        rows, growth = thinned(self.scene.means, visible, self.most, eye)
        if self._last is None or not np.array_equal(rows, self._last[0]) or not np.array_equal(growth, self._last[1]):
            self._last = rows, growth, self._splats_of(self.scene.select(rows), rows, None, growth)
        shown = self._last[2]
        return shown if eye is None else replace(shown, colours=_colours(self.scene.select(rows), eye))

    def _replacements(self, now: Snapshot, part: Part, eye: Camera | None) -> Iterator[Splats]:
        """Yield Gaussians that the scene does not have: parts of split ones, fitted ones, and what was filled in."""
        for place, marked in enumerate(now.objects):
            result = marked.result
            if result is None or marked.hidden:
                continue
            if part == "Everything" or (part == "Object" and place == now.active):
                rows = _new_rows(marked)
                yield self._splats_of(result.object.select(rows), result.objects[0].source_index[rows], eye)
            if part != "Object":
                first = len(result.background_rows)
                labels, sources = result.background_label[first:], result.background_source[first:]
                rows = np.where(labels == RowLabel.RELIT, sources, _PART_OUTSIDE)
                rows[labels == RowLabel.FILLED] = _MADE_UP
                yield self._splats_of(result.appended, rows, eye)

    def _splats_of(
        self, gaussians: Gaussians, rows: IntArray, eye: Camera | None, growth: FloatArray | None = None
    ) -> Splats:
        """Return Gaussians from rows of the scene as a viewer draws them, their variances larger by factors (M,)."""
        scale = self.frame.scale**2 * (1 if growth is None else growth[:, None, None])
        return Splats(
            self.frame.to_viewer(gaussians.means).astype(np.float32),
            (gaussians.covariances() * scale).astype(np.float32),
            _colours(gaussians, eye),
            gaussians.opacities[:, None].astype(np.float32),
            rows,
        )


def _changes(now: Snapshot, splats: Splats) -> Iterator[tuple[BoolArray, tuple[int, int, int]]]:
    """Yield which of the splats were changed, (M,), and in which colours they are shown."""
    real = splats.rows >= 0
    yield splats.rows == _MADE_UP, MADE_UP
    for marked in now.objects:
        added, removed, cut, relit = (real & rows[splats.rows] for rows in changed_rows(marked))
        yield relit, MADE_UP
        yield cut, CUT
        yield removed, REMOVED
        yield added, ADDED


def shown_rows(now: Snapshot, showing: Showing) -> BoolArray:
    """Return which Gaussians of the scene are to be seen, whole or as what a trim has in their place, (N,)."""
    after = showing.when == "Cut-out"
    owner = _owners(now, after)
    if showing.part == "Object" and not showing.ghost:
        corrected = now.object.fresh is not None and now.object.before is not None  # what a mark removed is gone
        removed = changed_rows(now.object)[1] if showing.colours == "Changes" and not corrected else False
        return np.asarray((owner == now.active) | removed)
    unseen = np.zeros(len(owner), np.bool_)
    for place, part in enumerate(now.objects):
        if part.hidden:
            unseen |= owner == place
        elif after and (result := part.result) is not None:
            unseen[result.discarded] = True
            unseen[_relit_rows(result)] = True
    return ~unseen & (owner < 0) if showing.part == "Scene without it" else ~unseen


def markable_rows(now: Snapshot, showing: Showing) -> BoolArray:
    """Return which Gaussians a mark can change, (N,).

    Those that are shown and, with the object alone, those that are selected and that its trim has removed.
    """
    shown = shown_rows(now, showing)
    return shown | now.object.selected.mask if showing.part == "Object" else shown


def changed_rows(part: MarkedObject) -> tuple[BoolArray, BoolArray, BoolArray, BoolArray]:
    """Return rows of the scene that were added, removed, cut to the outline, and freed from the shadow, (N,) each.

    By the marks since the last cut-out or, if there are none, by the trim.
    """
    result, had, has = part.fresh, part.before, part.mask
    cut, relit = np.zeros(len(has), np.bool_), np.zeros(len(has), np.bool_)
    if had is None:
        had = has if result is None else result.selection
        if result is not None:
            cut[result.objects[0].source_index[_new_rows(part)]] = True
            relit[_relit_rows(result)] = True
    return has & ~had, had & ~has, cut, relit


def _owners(now: Snapshot, after: bool) -> NDArray[np.int16]:
    """Return the place of the object that has each Gaussian of the scene, (N,); -1 for none; the active one first."""
    owner = np.full(len(now.object.selected.mask), -1, np.int16)
    order = [place for place in range(len(now.objects)) if place != now.active] + [now.active]
    for place in order:
        part = now.objects[place]
        owner[part.mask if after else part.selected.mask] = place
    return owner


def _new_rows(part: MarkedObject) -> IntArray:
    """Return rows of an object's trim that the scene does not have: parts of split Gaussians, and fitted ones."""
    result = part.result
    assert result is not None
    trimmed = result.objects[0]
    rows = np.union1d(np.flatnonzero(trimmed.label == RowLabel.SPLIT_INSIDE), trimmed.fitted)
    return rows if part.fresh is not None else rows[part.mask[trimmed.source_index[rows]]]


def _relit_rows(result: TrimResult) -> IntArray:
    """Return rows of the scene that a trim freed from the object's shadow."""
    return np.asarray(result.background_source[result.background_label == RowLabel.RELIT])


def _replaced_rows(now: Snapshot, after: bool) -> BoolArray:
    """Return Gaussians of the scene in whose place a trim has others, (N,)."""
    replaced = np.zeros(len(now.object.selected.mask), np.bool_)
    for part in now.objects:
        if after and part.result is not None and not part.hidden:
            replaced[part.result.objects[0].source_index[_new_rows(part)]] = True
    return replaced


def _colours(gaussians: Gaussians, eye: Camera | None) -> FloatArray:
    """Return colours towards an eye, or the mean over all sides, (M, 3)."""
    if eye is None or gaussians.sh_degree == 0:
        return np.asarray(np.clip(0.5 + SH_C0 * gaussians.sh_dc, 0, 1), np.float32)
    return np.asarray(np.clip(view_colours(gaussians, eye), 0, 1), np.float32)


def _joined(parts: list[Splats]) -> Splats:
    return Splats(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Splats)))


def thinned(means: FloatArray, visible: BoolArray, most: int, eye: Camera | None = None) -> tuple[IntArray, FloatArray]:
    """Return rows of about `most` of the visible Gaussians at most, and how much the variance of each grows, (M,) each.

    Each is drawn by its importance: at random, but the same every time, so that little changes as the eye moves.
    Surfaces stay closed where areas grow as numbers shrink.

    Args:
        means: centres, (N, 3).
        visible: which may be shown, (N,).
        most: number of Gaussians that there is room for.
        eye: what is in its picture and near counts more; None: all count the same.
    """
    rows = np.flatnonzero(visible)
    if len(rows) <= most:
        return rows, np.ones(len(rows), np.float32)
    weights = np.ones(len(rows)) if eye is None else _importance(means[rows].astype(np.float64), eye)
    chances = _chances(weights, most)
    drawn = np.random.default_rng(0).random(len(visible))[rows] < chances
    return rows[drawn], (1 / chances[drawn]).astype(np.float32)


def _importance(points: Float64Array, eye: Camera) -> Float64Array:
    """Return how much points (M, 3) count: as their area in the picture, (M,)."""
    distances = np.linalg.norm(points - eye.centre, axis=1)
    weights = 1 / np.maximum(distances, _NEAREST * max(float(np.median(distances)), 1e-9)) ** 2
    pixels, depths = eye.project(points)
    size = np.array([eye.width, eye.height])
    with np.errstate(invalid="ignore"):  # NaN behind the camera, which no comparison lets through
        within = ((pixels > -_PICTURE_MARGIN * size) & (pixels < (1 + _PICTURE_MARGIN) * size)).all(axis=1)
    return np.asarray(weights * np.where(within & (depths > 0), 1.0, _BESIDE_PICTURE))


def _chances(weights: Float64Array, most: int) -> Float64Array:
    """Return chances at most 1, otherwise in proportion to weights, whose sum is about `most`, (M,)."""
    low, high = 0.0, most / float(weights.min())
    for _ in range(_ROUNDS):
        middle = (low + high) / 2
        low, high = (middle, high) if np.minimum(1, middle * weights).sum() < most else (low, middle)
    return np.asarray(np.minimum(1, low * weights))
