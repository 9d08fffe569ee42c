"""From a scene to its objects: reads as the algorithm, and each step is a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, zip_longest
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet, Viewpoint, point_of, up_frame
from gaussian_trimmer.finding.found import (
    DOUBTFUL,
    MIN_SHARE_AT_ALL,
    FindConfig,
    FoundObject,
    FoundObjects,
    name_objects,
)
from gaussian_trimmer.finding.tiles import (
    Candidate,
    TallThings,
    Tile,
    choose_objects,
    most_agreed_on,
    plan_tiles,
)
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians, IntArray, check_gaussians
from gaussian_trimmer.geometry.copies import Distinct, distinct_gaussians
from gaussian_trimmer.geometry.limits import check_places
from gaussian_trimmer.geometry.storey import Storey, find_storey, sampled, tile_sides
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.surface.overview import views_of_all
from gaussian_trimmer.surface.regions import find_regions
from gaussian_trimmer.surface.room_surfaces import find_room
from gaussian_trimmer.surface.visible_surface import (
    Look,
    MeasuredSurface,
    NothingShowsError,
    find_visible_surface,
    look_at,
    measure,
    views_of,
    visible_surface,
    with_hidden,
)
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

HIDDEN_REACH = 0.05
"""Distance, in units, up to which what does not show belongs to the visible Gaussian next to it."""
END_PERCENTILES = (2, 98)
"""Percentiles of an object's centres that are taken for its ends."""
_LEVELS = (3.0, 2.0, 1.0)
"""Log-odds that regions of a tile which touch must have to be joined, ever more easily."""
_MIN_GAUSSIANS = 5
"""Smallest number of Gaussians of an object in a tile."""
_TILE_FILL = 1.8
"""Width of a tile in its pictures: corners, and what is near them, are seen in the middle of the next tile."""
_CUT_SHARE = 0.1
"""An object that ends nearer than this share of its height to where the ceiling was cut off may go on above."""
_MIN_SEEN = 0.5
"""Share of what is seen at the point that is of an object there, at least."""


def close_config(config: FindConfig) -> FindConfig:
    """Return what counts as an object in a tile: all that is named may be sure; its Gaussians tell how large it is."""
    return replace(config, min_shown=MIN_SHARE_AT_ALL * config.min_shown)


def look_at_tile(scene: Gaussians, tile: Tile, up: Float64Array) -> Look | None:
    """Look at a tile of a scene from above; None where hardly anything shows."""
    part = scene.select(tile.rows)
    try:
        look = look_at(part, views_of_all(part, up, _TILE_FILL))
    except NothingShowsError:
        return None
    return replace(look, rows=tile.rows[look.rows])


def candidates_in_tile(
    scene: Gaussians,
    tile: Tile,
    look: Look,
    measured: MeasuredSurface,
    up: Float64Array,
    top: float,
    config: FindConfig,
) -> list[Candidate]:
    """Find the objects that lie whole within a tile; which of them go on up to the ceiling is told later.

    Args:
        scene: the N Gaussians below the cut.
        tile: which of them were looked at.
        look: what shows.
        measured: that of all tiles.
        up: the up vector, (3,).
        top: height at which the capture was cut.
        config: what counts as an object, as `close_config` returns it.
    """
    surface = visible_surface(scene, look, measured, up)
    room, candidates = find_room(surface), []
    for regions in find_regions(surface, room, levels=_LEVELS):
        found, numbers = name_objects(surface, room, regions, config)
        labels = with_hidden(surface, numbers, HIDDEN_REACH, tile.rows)
        order = np.argsort(labels, kind="stable")
        parts = np.split(tile.rows[order], np.searchsorted(labels[order], np.arange(1, len(found) + 1)))[1:]
        for thing, rows in zip(found, parts, strict=True):
            if len(rows) < _MIN_GAUSSIANS or thing.region is None:
                continue
            points = scene.means[rows].astype(np.float64) @ surface.axes.T
            low, high = np.percentile(points, END_PERCENTILES, axis=0)
            if tile.holds(low[:2], high[:2]):
                cut = bool(high[2] > top - _CUT_SHARE * (high[2] - low[2]))
                candidates.append(Candidate(rows, thing, cut))
    return candidates


@dataclass(frozen=True, eq=False)
class ThingsAtPoints:
    """Finds what stands at points of a capture of N Gaussians; what is the same for all points is found once."""

    scene: Gaussians
    up: Float64Array
    """The up vector, (3,)."""

    def at(self, point: Float64Array, seen: FloatArray) -> list[IntArray]:
        """Return the objects at a point, the rows of each, ascending.

        The first is the one that the looks agree on most, then come the next larger one, the next smaller one, and so
        on. Where no more agree than are found in one tile, as in that of a sofa's cushions, a larger one is looked at.

        Args:
            point: a point on what is meant, (3,).
            seen: weight of each Gaussian in what is seen there, (N,).
        """
        x, y, heights, storey, (largest, *smaller) = self._plan
        height, top = float(self.up @ point), storey.head_height
        if storey.ceiling is not None:
            top = (height + storey.ceiling) / 2
        below = heights < top
        if height >= top or not below.any():
            return []
        middle = up_frame(self.up)[:2] @ point
        distance = np.maximum(np.abs(x - middle[0]), np.abs(y - middle[1]))
        looked_at, weight = np.where(below, distance, np.inf), seen / max(float(seen.sum()), 1e-9)

        def found_in(sides: Sequence[float]) -> list[Candidate]:
            rows, config = np.flatnonzero(looked_at <= max(sides) / 2), close_config(FindConfig())
            near = self.scene.select(rows)
            tiles = [Tile(middle - side / 2, side, np.flatnonzero(looked_at[rows] <= side / 2)) for side in sides]
            looked = [(tile, look) for tile in tiles if (look := look_at_tile(near, tile, self.up)) is not None]
            if not looked:
                return []
            measured = measure(near, [look for _, look in looked])
            found = parallel_map(
                lambda tile, look: candidates_in_tile(near, tile, look, measured, self.up, top, config),
                *zip(*looked, strict=True),
            )
            things = [replace(one, rows=rows[one.rows]) for of_tile in found for one in of_tile]
            return [one for one in things if weight[one.rows].sum() > _MIN_SEEN]

        found = found_in(smaller)  # what is meant is seen nearby
        agreed, alike = most_agreed_on(found, len(self.scene))
        if alike <= len(_LEVELS):
            agreed, _ = most_agreed_on([*found, *found_in([largest])], len(self.scene))
        if not agreed:
            return []
        around = np.flatnonzero(distance <= largest / 2)
        tall = TallThings(self.scene.select(around), self.up, storey, top)

        def whole(one: Candidate) -> IntArray:
            """Return the rows of a thing, with what was cut off it."""
            if not one.cut_off or tall.reaches_ceiling(np.searchsorted(around, one.rows)):
                return one.rows
            return around[np.flatnonzero(tall.grown(np.isin(around, one.rows).astype(np.int64), [1]))]

        first, *others = map(whole, agreed)
        larger = sorted((one for one in others if len(one) > len(first)), key=len)
        lesser = sorted((one for one in others if len(one) <= len(first)), key=len, reverse=True)
        in_turn = chain.from_iterable(zip_longest(larger, lesser))
        return [one for one in (first, *in_turn) if one is not None]

    @property
    def needed(self) -> bool:
        """Whether the place is so large that a click needs a look of its own."""
        return len(self._plan[4]) > 0

    @cached_property
    def _plan(self) -> tuple[Float64Array, Float64Array, Float64Array, Storey, tuple[float, ...]]:
        """Two horizontal coordinates and heights, (N,) each, where floor and ceiling are, and the sides of tiles."""
        means = self.scene.means.astype(np.float64)
        x, y = np.ascontiguousarray((means @ up_frame(self.up)[:2].T).T)
        storey, heights = find_storey(sampled(self.scene), self.up), means @ self.up
        return x, y, heights, storey, tile_sides(storey, heights)


def find_objects(
    scene: Gaussians,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    config: FindConfig | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> FoundObjects:
    """Find every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Rooms below a ceiling, and places with ground much wider than things are high, as a garden, are divided into tiles
    that are looked at one by one from above, without the ceiling; an object is what several tiles agree on. Copies of a
    Gaussian count as one. Nothing is sure while the up vector is a guess.

    Args:
        scene: all N Gaussians.
        cameras: the cameras that the scene was trained with, if known. Large captures are looked at without them.
        up: the up vector in the scene's coordinates, if known: three numbers, an axis, "z" or "-y", or as `find_up`
            returns it.
        config: what counts as an object; the usual, if not given.
        progress: called with the name of each step when it begins: `look`, and `look 1/16` and so on for its views or
            tiles, `surfaces`, `regions`, and for tiles `regions 1/16` and so on, and `agree`.

    Raises:
        InputError: the coordinates are as large as a map's, the up vector is not valid, or hardly anything shows in the
            views.
    """
    clock, config = Clock(progress, log=None), config or FindConfig()
    check_gaussians(scene)
    check_places(scene)
    distinct = distinct_gaussians(scene)
    found_up = find_up(distinct.gaussians, cameras, up)
    found = _find_among(distinct.gaussians, found_up, cameras, config, clock, progress)
    if not found_up.is_sure:
        found = replace(found, objects=tuple(_doubted(one) for one in found))
    return found if distinct.gaussians is scene else _with_copies(found, scene, distinct)


def _doubted(one: FoundObject) -> FoundObject:
    """Return what is found while up is a guess: what stands may as well lean."""
    return replace(one, confidence=min(one.confidence, DOUBTFUL), doubts=("up is a guess", *one.doubts))


def _find_among(
    scene: Gaussians,
    found_up: UpVector,
    cameras: CameraSet | None,
    config: FindConfig,
    clock: Clock,
    progress: Callable[[str], None],
) -> FoundObjects:
    """Find the objects of a scene without copies; takes what `find_objects` takes and has checked."""
    storey = find_storey(scene, found_up.direction)
    sides = tile_sides(storey, scene.means.astype(np.float64) @ found_up.direction)
    if sides:
        return _find_in_tiles(scene, found_up, storey, sides, close_config(config), clock)
    with clock("look"):
        views = views_of(scene, cameras, found_up.direction)
        surface = find_visible_surface(
            scene, views, found_up.direction, lambda number: progress(f"look {number}/{len(views)}")
        )
    with clock("surfaces"):
        room = find_room(surface)
    with clock("regions"):
        found, numbers = name_objects(surface, room, find_regions(surface, room)[0], config)
        labels = with_hidden(surface, numbers, HIDDEN_REACH, np.arange(len(scene)))
    objects = _described(scene, labels, found)
    looked_at = np.ones(len(scene), np.bool_)
    return FoundObjects(scene, labels, objects, tuple(views), looked_at, found_up, clock.seconds, surface)


def _find_in_tiles(
    scene: Gaussians, up: UpVector, storey: Storey, sides: Sequence[float], config: FindConfig, clock: Clock
) -> FoundObjects:
    """Find the objects of a large capture or of rooms, tile by tile.

    Args:
        scene: all N Gaussians.
        up: the up vector.
        storey: where floor and ceiling are.
        sides: of the tiles of each size, in scene units.
        config: what counts as an object in a tile.
        clock: told what is done.
    """
    below = scene.means.astype(np.float64) @ up.direction < storey.head_height  # (N,)
    shown_rows = np.flatnonzero(below)
    shown = scene.select(shown_rows)
    plan = shown.means.astype(np.float64) @ up_frame(up.direction)[:2].T
    tiles = [tile for side in sides for tile in plan_tiles(plan, side)]
    seen = list[tuple[Tile, Look]]()
    with clock("look"):
        for number, look in enumerate(parallel_map(lambda tile: look_at_tile(shown, tile, up.direction), tiles)):
            clock.part(f"look {number + 1}/{len(tiles)}")
            seen += [(tiles[number], look)] if look is not None else []
    if not seen:
        raise NothingShowsError("Hardly anything shows from above; check the up vector.")
    with clock("surfaces"):
        measured = measure(shown, [look for _, look in seen])
    views, candidates = list[Viewpoint](), list[Candidate]()
    tall = TallThings(scene, up.direction, storey, storey.head_height)
    with clock("regions"):
        found = parallel_map(
            lambda one: candidates_in_tile(shown, one[0], one[1], measured, up.direction, storey.head_height, config),
            seen,
        )
        for number, (found_there, (_, look)) in enumerate(zip(found, seen, strict=True), 1):
            clock.part(f"regions {number}/{len(seen)}")
            for one in found_there:
                thing = replace(one.thing, view=len(views) + one.thing.view)
                reaches_ceiling = one.cut_off and tall.reaches_ceiling(shown_rows[one.rows])
                candidates.append(replace(one, thing=thing, reaches_ceiling=reaches_ceiling))
            views += look.views
    with clock("agree"):
        agreed = sorted(
            choose_objects(candidates, len(shown), up.direction, parts=config.parts),
            key=lambda one: (not one.thing.sure, -len(one.rows)),
        )
        labels = np.zeros(len(scene), np.int64)
        for number, one in enumerate(agreed, 1):
            labels[shown_rows[one.rows]] = number
        cut_off = [n for n, one in enumerate(agreed, 1) if one.cut_off and not one.reaches_ceiling]
        labels = tall.grown(labels, cut_off) if cut_off else labels
    things = [one.thing for one in agreed]
    for number in cut_off:
        centre, size = _box_of(scene, labels == number, up)
        things[number - 1] = replace(things[number - 1], centre=centre, size=size)
    objects = _described(scene, labels, things)
    return FoundObjects(scene, labels, objects, tuple(views), below | (labels > 0), up, clock.seconds)


def _with_copies(found: FoundObjects, scene: Gaussians, distinct: Distinct) -> FoundObjects:
    """Return what was found among the distinct Gaussians of a scene of N with all their copies."""
    rows, of, surface = distinct.rows, distinct.of, found.surface
    if surface is not None:
        known = surface.measured
        nearest, distance = known.nearest[of], known.distance[of]
        measured = replace(known, rows=rows[known.rows], nearest=nearest, distance=distance)
        surface = replace(surface, rows=rows[surface.rows], measured=measured)
    labels, looked_at = found.labels[of], found.looked_at[of]
    objects = _described(scene, labels, found.objects)
    return replace(found, scene=scene, labels=labels, objects=objects, looked_at=looked_at, surface=surface)


def _box_of(scene: Gaussians, mask: BoolArray, up: UpVector) -> tuple[Float64Array, Float64Array]:
    """Return the middle of the box around the Gaussians of a mask (N,), (3,), and its size as seen along up, (3,)."""
    axes = up_frame(up.direction)
    low, high = np.percentile(scene.means[mask].astype(np.float64) @ axes.T, END_PERCENTILES, axis=0)
    return (low + high) / 2 @ axes, high - low


def _described(scene: Gaussians, labels: IntArray, found: Sequence[FoundObject]) -> tuple[FoundObject, ...]:
    """Return objects with their numbers among the labels (N,), in order, and what their Gaussians tell of them."""
    described = []
    for number, one in enumerate(found, 1):
        rows = np.flatnonzero(labels == number)
        colour = np.clip(0.5 + SH_C0 * scene.sh_dc[rows].mean(axis=0, dtype=np.float64), 0, 1)
        described.append(replace(one, id=number, gaussians=len(rows), colour=point_of(colour)))
    return tuple(described)
