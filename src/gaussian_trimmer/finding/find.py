"""From a scene to its objects: reads as the algorithm, and each step is a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet, Viewpoint, up_frame
from gaussian_trimmer.finding.agreement import Candidate, agree
from gaussian_trimmer.finding.found import FoundObject, FoundObjects, Verdict
from gaussian_trimmer.finding.judging import MIN_SHARE_AT_ALL, FindConfig, judge, judge_surface
from gaussian_trimmer.finding.tall_things import TallThings
from gaussian_trimmer.finding.tiles import LARGEST_LOOK, Tile, plan_tiles, tile_counts
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, Gaussians, IntArray, check_gaussians
from gaussian_trimmer.geometry.limits import check_places
from gaussian_trimmer.geometry.storey import Storey, find_storey
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.surface.overview import views_of_all
from gaussian_trimmer.surface.regions import find_regions
from gaussian_trimmer.surface.room_surfaces import Room, find_room
from gaussian_trimmer.surface.visible_surface import (
    Look,
    MeasuredSurface,
    NothingShowsError,
    VisibleSurface,
    find_visible_surface,
    look_at,
    measure,
    views_of,
    visible_surface,
    with_hidden,
)
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

LEVELS = (3.0, 2.0, 1.0)
"""Log-odds that regions of a tile which touch must have to be joined, ever more easily."""
_HIDDEN_REACH = 0.05
"""Distance, in units, up to which what does not show belongs to the visible Gaussian next to it."""
_MIN_GAUSSIANS = 5
"""Smallest number of Gaussians of an object in a tile."""
_END_PERCENTILES = (2, 98)
"""Percentiles of an object's centres that are taken for its ends."""
_TILE_FILL = 1.8
"""Width of a tile in its pictures: corners, and what is near them, are seen in the middle of the next tile."""
_CUT_SHARE = 0.1
"""An object that ends nearer than this share of its height to where the ceiling was cut off may go on above."""


def find_objects(
    scene: Gaussians,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    config: FindConfig | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> FoundObjects:
    """Find every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Rooms below a ceiling, and captures of more than 200,000 Gaussians, as of a garden, are divided into tiles that are
    looked at one by one from above, without the ceiling; an object is what several tiles agree on.

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
    found_up = find_up(scene, cameras, up)
    looks = Looks(found_up.direction, config)
    storey = find_storey(scene, found_up.direction)
    if storey.is_room or len(scene) > LARGEST_LOOK:
        return _find_in_tiles(scene, found_up, storey, looks.close(), clock)
    with clock("look"):
        views = views_of(scene, cameras, found_up.direction)
        surface = find_visible_surface(
            scene, views, found_up.direction, lambda number: progress(f"look {number}/{len(views)}")
        )
    with clock("surfaces"):
        room = find_room(surface)
    with clock("regions"):
        [(verdicts, numbers)] = looks.judged(surface, room, (0.0,))
        labels = with_hidden(surface, numbers, _HIDDEN_REACH, np.arange(len(scene)))
    objects = tuple(_described(scene, labels, number, verdict) for number, verdict in enumerate(verdicts, 1))
    looked_at = np.ones(len(scene), np.bool_)
    return FoundObjects(scene, labels, objects, tuple(views), looked_at, found_up, clock.seconds, surface)


@dataclass(frozen=True, eq=False)
class Looks:
    """How scenes and tiles are looked at."""

    up: Float64Array
    config: FindConfig

    def close(self) -> Looks:
        """Return the same at tiles, where what is named at all may be sure; its Gaussians tell how large it is."""
        return replace(self, config=replace(self.config, min_shown=MIN_SHARE_AT_ALL * self.config.min_shown))

    def judged(
        self, surface: VisibleSurface, room: Room, levels: Sequence[float]
    ) -> list[tuple[list[Verdict], IntArray]]:
        """Find what may be an object at each level, and the number (S,) of that of each Gaussian of the surface.

        Args:
            surface: what shows, S Gaussians.
            room: the flat surfaces.
            levels: log-odds that regions which touch must have to be joined, falling.
        """
        found = find_regions(surface, room, levels=levels)
        return [name_objects(surface, room, regions, self.config) for regions in found]

    def tile(self, scene: Gaussians, tile: Tile) -> Look | None:
        """Look at a tile of a scene from above; None where hardly anything shows."""
        part = scene.select(tile.rows)
        try:
            look = look_at(part, views_of_all(part, self.up, _TILE_FILL))
        except NothingShowsError:
            return None
        return replace(look, rows=tile.rows[look.rows])

    def candidates(
        self, scene: Gaussians, tile: Tile, look: Look, measured: MeasuredSurface, top: float
    ) -> list[Candidate]:
        """Find the objects that lie whole within a tile, as if none of them reached the ceiling.

        Args:
            scene: the N Gaussians below the cut.
            tile: which of them were looked at.
            look: what shows.
            measured: that of all tiles.
            top: height at which the capture was cut.
        """
        surface = visible_surface(scene, look, measured, self.up)
        found = []
        for verdicts, numbers in self.judged(surface, find_room(surface), LEVELS):
            labels = with_hidden(surface, numbers, _HIDDEN_REACH, tile.rows)
            order = np.argsort(labels, kind="stable")
            parts = np.split(tile.rows[order], np.searchsorted(labels[order], np.arange(1, len(verdicts) + 1)))[1:]
            for verdict, rows in zip(verdicts, parts, strict=True):
                if len(rows) < _MIN_GAUSSIANS or verdict.region is None:
                    continue
                points = scene.means[rows].astype(np.float64) @ surface.axes.T
                low, high = np.percentile(points, _END_PERCENTILES, axis=0)
                if tile.holds(low[:2], high[:2]):
                    cut = bool(high[2] > top - _CUT_SHARE * (high[2] - low[2]))
                    found.append(Candidate(rows, verdict, cut, False))
        return found


def _find_in_tiles(scene: Gaussians, up: UpVector, storey: Storey, looks: Looks, clock: Clock) -> FoundObjects:
    """Find the objects of a large capture or of rooms, tile by tile.

    Args:
        scene: all N Gaussians.
        up: the up vector.
        storey: where floor and ceiling are.
        looks: how tiles are looked at.
        clock: told what is done.
    """
    below = scene.means.astype(np.float64) @ up.direction < storey.head_height  # (N,)
    shown_rows = np.flatnonzero(below)
    shown = scene.select(shown_rows)
    plan = shown.means.astype(np.float64) @ up_frame(up.direction)[:2].T
    tiles = [tile for count in tile_counts(len(shown)) for tile in plan_tiles(plan, count)]
    seen = list[tuple[Tile, Look]]()
    with clock("look"):
        for number, look in enumerate(parallel_map(lambda tile: looks.tile(shown, tile), tiles)):
            clock.part(f"look {number + 1}/{len(tiles)}")
            seen += [(tiles[number], look)] if look is not None else []
    if not seen:
        raise NothingShowsError("Hardly anything shows from above; check the up vector.")
    with clock("surfaces"):
        measured = measure(shown, [look for _, look in seen])
    views, candidates = list[Viewpoint](), list[Candidate]()
    tall = TallThings(scene, up.direction, storey, storey.head_height)
    with clock("regions"):
        found = parallel_map(lambda one: looks.candidates(shown, one[0], one[1], measured, storey.head_height), seen)
        for number, (found_there, (_, look)) in enumerate(zip(found, seen, strict=True), 1):
            clock.part(f"regions {number}/{len(seen)}")
            for one in found_there:
                verdict = replace(one.verdict, view=len(views) + one.verdict.view)
                reaches_ceiling = one.cut_off and tall.reaches_ceiling(shown_rows[one.rows])
                candidates.append(replace(one, verdict=verdict, reaches_ceiling=reaches_ceiling))
            views += look.views
    with clock("agree"):
        agreed = sorted(
            agree(candidates, len(shown), up.direction, parts=looks.config.parts),
            key=lambda one: (not one.verdict.sure, -len(one.rows)),
        )
        labels = np.zeros(len(scene), np.int64)
        for number, one in enumerate(agreed, 1):
            labels[shown_rows[one.rows]] = number
        cut_off = [n for n, one in enumerate(agreed, 1) if one.cut_off and not one.reaches_ceiling]
        labels = tall.grown(labels, cut_off) if cut_off else labels
    verdicts = [one.verdict for one in agreed]
    for number in cut_off:
        centre, size = _box_of(scene, labels == number, up)
        verdicts[number - 1] = replace(verdicts[number - 1], centre=centre, size=size)
    objects = tuple(_described(scene, labels, number, verdict) for number, verdict in enumerate(verdicts, 1))
    return FoundObjects(scene, labels, objects, tuple(views), below | (labels > 0), up, clock.seconds)


def name_objects(
    surface: VisibleSurface, room: Room, regions: IntArray, config: FindConfig
) -> tuple[list[Verdict], IntArray]:
    """Choose the objects among the regions; return them and the number of that of each Gaussian, from 1, 0: none, (S,).

    Args:
        surface: what shows of the scene, S Gaussians.
        room: its flat surfaces.
        regions: as `find_regions` gives them, (S,).
        config: what counts as an object.
    """
    verdicts = judge(surface, room, regions, config)
    numbers = np.zeros(len(surface.rows), np.int64)
    for number, verdict in enumerate(verdicts, 1):
        numbers[regions == verdict.region] = number
    if config.surfaces:
        for one in room.surfaces:
            rows = one.own & (regions < 0) & (numbers == 0)
            if rows.any():
                verdicts.append(judge_surface(surface, one, rows))
                numbers[rows] = len(verdicts)
    return verdicts, numbers


def _box_of(scene: Gaussians, mask: BoolArray, up: UpVector) -> tuple[Float64Array, Float64Array]:
    """Return the middle of the box around the Gaussians of a mask (N,), (3,), and its size as seen along up, (3,)."""
    axes = up_frame(up.direction)
    low, high = np.percentile(scene.means[mask].astype(np.float64) @ axes.T, _END_PERCENTILES, axis=0)
    return (low + high) / 2 @ axes, high - low


def _described(scene: Gaussians, labels: IntArray, number: int, verdict: Verdict) -> FoundObject:
    """Describe one object as users know it."""
    rows = np.flatnonzero(labels == number)
    colour = np.clip(0.5 + SH_C0 * scene.sh_dc[rows].mean(axis=0, dtype=np.float64), 0, 1)
    return FoundObject(**vars(verdict), id=number, colour=np.asarray(colour, np.float64), gaussians=len(rows))
