"""Several objects of one scene, trimmed one after the other and shared out: no Gaussian belongs to two of them.

Each object is trimmed as it would be alone. Where two of them claim a Gaussian, the one whose selection had it keeps
it, and else the one that most of its nearest neighbours belong to. The background is what no object has, but for what
only the objects hid.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.config import CONTEXT_RADIUS, TrimConfig, check_config
from gaussian_trimmer.decomposition.ghosts import hidden_by_several
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.geometry.support_plane import SupportPlane, find_support_plane
from gaussian_trimmer.planning.diagnosis import doubts_about_up
from gaussian_trimmer.planning.up_vector import KNOWN_SOURCES, find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.result import RowLabel, TrimResult
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, Segmenter, get_segmenter
from gaussian_trimmer.trimming.arguments import check_scene, mask_of_excluded, mask_of_selection, settings
from gaussian_trimmer.trimming.finishing import small_views
from gaussian_trimmer.trimming.plugin_checks import CheckedRenderer
from gaussian_trimmer.trimming.trim import KnownUp, trim_checked
from gaussian_trimmer.views import TrimmedView

_VOTERS = 8
"""Number of nearest Gaussians that decide to which of several objects one belongs."""
_NOBODY = -1


@dataclass(frozen=True, eq=False)
class TrimmedObject:
    """One of several objects."""

    id: int
    gaussians: Gaussians
    """Whole Gaussians in the order of the scene, then the inner parts of split ones, (M,)."""
    source_index: IntArray
    """Scene row of each, (M,)."""
    label: NDArray[np.uint8]
    """What happened to each, a `RowLabel`, (M,)."""
    fitted: IntArray
    """Which of these rows were fitted to the object's outline, ascending."""
    selection: BoolArray
    """The rough selection, (N,)."""
    bounds: Bounds
    """Bounds of the rough object."""
    view: TrimmedView | None
    """A view of it, an accepted one if there is one; None if the selection was refused before any was planned."""
    refused: str | None
    """Why it was left as it was; None if it was trimmed."""
    given_up: int
    """Number of Gaussians that it claimed and another object got."""
    report: dict[str, Any]
    """The report of its own trim."""


@dataclass(frozen=True, eq=False)
class ObjectsResult:
    """Several objects and the scene without them, complementary: every Gaussian is in one of them, or split."""

    scene: Gaussians
    """The Gaussians that were given."""
    objects: tuple[TrimmedObject, ...]
    background_rows: IntArray
    """Scene rows of the Gaussians that are whole in the background, ascending."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    outside_source: IntArray
    """Scene row of each of these."""
    contested: int
    """Number of Gaussians that several objects claimed."""
    dropped: IntArray
    """Scene rows, ascending, of what showed only once the objects were gone: no part has them."""
    seconds: dict[str, float]
    """Time taken by each object, by its id, by sharing out, and by cleaning the background."""
    used_renderer: Renderer
    """What draws the pictures that are saved."""

    @cached_property
    def background(self) -> Gaussians:
        """The scene without all objects: other Gaussians, then the outer parts of split ones."""
        return concatenate([self.scene.select(self.background_rows), self.outside_parts])

    @property
    def labels(self) -> NDArray[np.int64]:
        """Id of the object that has each Gaussian of the scene, whole or in part, and 0 for the background, (N,)."""
        labels = np.zeros(len(self.scene), np.int64)
        for part in self.objects:
            labels[part.source_index] = part.id
        return labels

    @property
    def source_index(self) -> IntArray:
        """Scene row of each row of the objects, in order, and then of the background."""
        return np.concatenate(
            [*(part.source_index for part in self.objects), self.background_rows, self.outside_source]
        )

    @property
    def fitted(self) -> IntArray:
        """Which of these rows were fitted to the outline of their object, ascending."""
        starts = np.cumsum([0, *(len(part.gaussians) for part in self.objects)])
        return np.concatenate([start + part.fitted for start, part in zip(starts, self.objects, strict=False)])

    @property
    def label(self) -> NDArray[np.uint8]:
        """What happened to each of these rows, a `RowLabel`."""
        selected = np.any([part.selection for part in self.objects], axis=0)[self.background_rows]
        return np.concatenate([
            *(part.label for part in self.objects), np.where(selected, RowLabel.PRUNED, RowLabel.KEPT),
            np.full(len(self.outside_source), RowLabel.SPLIT_OUTSIDE),
        ]).astype(np.uint8)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Claim:
    """What one trim gave: the object's rows, and the outer parts of split Gaussians."""

    trimmed: TrimmedObject
    outside: Gaussians
    outside_source: IntArray


def trim_objects(
    scene: Gaussians,
    objects: Mapping[int, ArrayLike],
    *,
    config: TrimConfig | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    segmenter: Segmenter | str = DEFAULT_SEGMENTER,
    cameras: CameraSet | None = None,
    excluded: ArrayLike | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> ObjectsResult:
    """Sharpen rough selections of several objects of one scene, which share no Gaussian afterwards.

    Args:
        scene: all N Gaussians.
        objects: the rough selections by the objects' ids, each as `trim` takes it. They may overlap. What marks removed
            from one stays out of that one.
        config: settings of all stages.
        renderer: a renderer, or the name of one.
        segmenter: a segmenter, or the name of one.
        cameras: the cameras that the scene was trained with, if known.
        excluded: booleans (N,), which Gaussians become part of no object unless they are selected.
        progress: called with the id of each object, as text, when its turn comes.

    Raises:
        InputError: there is no object, or as `trim` for one of them.
    """
    if not objects:
        raise InputError("There is no object to trim; give at least one id with its selection.")
    config = config or TrimConfig()
    if config.fill:
        raise InputError("The holes of several objects cannot be filled; trim them one by one, or leave --fill out.")
    check_scene(scene, cameras)
    config = settings(config, None, None, None)
    check_config(config)
    check_magnitudes(scene)
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    segmenter = get_segmenter(segmenter) if isinstance(segmenter, str) else segmenter
    objects = {int(number): selection for number, selection in objects.items()}
    masks = {number: mask_of_selection(selection, len(scene)) for number, selection in objects.items()}
    known_up = _common_up(scene, np.any(list(masks.values()), axis=0), config, cameras)
    alone, from_all = replace(config, background="exact"), mask_of_excluded(None, excluded, len(scene))
    claims, seconds = [], {}
    for number, mask in masks.items():
        progress(f"object {number}")
        start = time.perf_counter()
        kept_out = from_all | mask_of_excluded(objects[number], None, len(scene))
        result = trim_checked(scene, mask, kept_out, alone, renderer, segmenter, cameras, known_up=known_up)
        claims.append(_claim(number, result))
        seconds[f"object {number}"] = time.perf_counter() - start
    progress("share out")
    start = time.perf_counter()
    owner, contested = share_out(scene, [claim.trimmed for claim in claims])
    kept = [_without_lost(claim, owner == place) for place, claim in enumerate(claims)]
    seconds["share out"] = time.perf_counter() - start
    dropped = np.zeros(len(scene), np.bool_)
    if config.background == "clean":
        progress("clean")
        start = time.perf_counter()
        dropped = find_dropped(scene, [claim.trimmed for claim in kept], owner, config, CheckedRenderer(renderer))
        seconds["clean"] = time.perf_counter() - start
    return ObjectsResult(
        scene, tuple(claim.trimmed for claim in kept), np.flatnonzero((owner == _NOBODY) & ~dropped),
        concatenate([claim.outside for claim in kept]), np.concatenate([claim.outside_source for claim in kept]),
        contested, np.flatnonzero(dropped), seconds, renderer,
    )  # fmt: skip


def _common_up(scene: Gaussians, selected: BoolArray, config: TrimConfig, cameras: CameraSet | None) -> KnownUp | None:
    """The up vector of the whole scene; None where each object must find the plane that it stands on."""
    up = find_up(scene, cameras, config.up, selected)
    return KnownUp(up, doubts_about_up(scene, selected, up)) if up.source in KNOWN_SOURCES else None


def find_dropped(
    scene: Gaussians, objects: Sequence[TrimmedObject], owner: IntArray, config: TrimConfig, renderer: Renderer
) -> BoolArray:
    """Which Gaussians of nobody showed only once the objects were gone, (N,).

    Args:
        scene: all N Gaussians.
        objects: the objects, trimmed.
        owner: place in the list of the object that has each Gaussian, -1 for none, (N,).
        config: settings of all stages.
        renderer: draws the scene.
    """
    dropped = np.zeros(len(scene), np.bool_)
    for place, part in enumerate(objects):
        own = owner == place
        if part.refused or not own.any():
            continue
        bounds = part.bounds
        distances = np.linalg.norm(scene.means - bounds.centre.astype(np.float32), axis=1)
        rows = np.flatnonzero(own | (distances < max(config.context_radius, CONTEXT_RADIUS) * bounds.radius))
        rows = rows[~dropped[rows]]
        local, ours = scene.select(rows), own[rows]
        positions = local.means / np.float32(bounds.radius)

        def plane_below(
            seen: FloatArray, positions: FloatArray = positions, ours: BoolArray = ours, bounds: Bounds = bounds
        ) -> SupportPlane | None:
            return find_support_plane(positions, ours, seen.astype(np.float64), bounds, config.label_crf.support_plane)

        ghosts = hidden_by_several(
            local, owner[rows] != _NOBODY, ours, bounds, plane_below, small_views(bounds)[::3], renderer
        )
        dropped[rows[ghosts]] = True
    return dropped


def share_out(scene: Gaussians, objects: Sequence[TrimmedObject]) -> tuple[IntArray, int]:
    """Place in the list of the object that gets each Gaussian, (N,), -1 for none, and how many were contested."""
    claimed = np.zeros((len(objects), len(scene)), np.bool_)
    for place, part in enumerate(objects):
        claimed[place, part.source_index] = True
    number = claimed.sum(axis=0)
    owner = np.where(number > 0, claimed.argmax(axis=0), _NOBODY)
    contested = np.flatnonzero(number > 1)
    if not len(contested):
        return owner, 0
    claims = claimed[:, contested]
    selected = claims & np.stack([part.selection[contested] for part in objects])
    clear = selected.sum(axis=0) == 1
    owner[contested[clear]] = selected[:, clear].argmax(axis=0)
    unclear, settled = contested[~clear], np.flatnonzero(number == 1)
    if len(unclear) and len(settled):
        _, near = nearest(scene.means[settled], scene.means[unclear], min(_VOTERS, len(settled)))
        voters = owner[settled[near]]
        votes = np.stack([(voters == place).sum(axis=1) for place in range(len(objects))])
        # Whoever claims it comes before whoever does not; of equal votes the first object wins.
        owner[unclear] = np.where(claims[:, ~clear], votes + 1, 0).argmax(axis=0)
    return owner, len(contested)


def _claim(number: int, result: TrimResult) -> _Claim:
    """What a trim gave, without what is large and no longer needed."""
    n = len(result.object)
    views = [view for view in result.views if not view.rejected] or list(result.views)
    trimmed = TrimmedObject(
        number, result.object, result.source_index[:n], result.label[:n], result.fitted, result.selection,
        result.bounds,
        views[0] if views else None, result.refused, 0, result.report,
    )  # fmt: skip
    return _Claim(
        trimmed, result.outside_parts, result.source_index[len(result.source_index) - len(result.outside_parts) :]
    )


def _without_lost(claim: _Claim, ours: BoolArray) -> _Claim:
    """A claim without the Gaussians that other objects got; `ours` says which rows of the scene remain, (N,)."""
    part = claim.trimmed
    kept, outside = ours[part.source_index], ours[claim.outside_source]
    if kept.all():
        return claim
    trimmed = TrimmedObject(
        part.id, part.gaussians.select(kept), part.source_index[kept], part.label[kept],
        np.flatnonzero(np.isin(np.flatnonzero(kept), part.fitted)), part.selection, part.bounds, part.view,
        part.refused, int(np.count_nonzero(~kept)), part.report,
    )  # fmt: skip
    return _Claim(trimmed, claim.outside.select(outside), claim.outside_source[outside])
