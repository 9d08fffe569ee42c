"""From a scene to its objects: reads as the algorithm, and each step is a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet, Viewpoint, point_of, up_frame
from gaussian_trimmer.finding.agreement import Candidate, choose_objects
from gaussian_trimmer.finding.found import FoundObject, FoundObjects
from gaussian_trimmer.finding.judging import FindConfig, name_objects
from gaussian_trimmer.finding.looking import (
    END_PERCENTILES,
    HIDDEN_REACH,
    candidates_in_tile,
    close_config,
    look_at_tile,
)
from gaussian_trimmer.finding.tiles import LARGEST_LOOK, TallThings, Tile, plan_tiles, tile_counts
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, Gaussians, IntArray, check_gaussians
from gaussian_trimmer.geometry.limits import check_places
from gaussian_trimmer.geometry.storey import Storey, find_storey
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.surface.regions import find_regions
from gaussian_trimmer.surface.room_surfaces import find_room
from gaussian_trimmer.surface.visible_surface import (
    Look,
    NothingShowsError,
    find_visible_surface,
    measure,
    views_of,
    with_hidden,
)
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.up_vector import UpVector, find_up


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
    storey = find_storey(scene, found_up.direction)
    if storey.is_room or len(scene) > LARGEST_LOOK:
        return _find_in_tiles(scene, found_up, storey, close_config(config), clock)
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


def _find_in_tiles(scene: Gaussians, up: UpVector, storey: Storey, config: FindConfig, clock: Clock) -> FoundObjects:
    """Find the objects of a large capture or of rooms, tile by tile.

    Args:
        scene: all N Gaussians.
        up: the up vector.
        storey: where floor and ceiling are.
        config: what counts as an object in a tile.
        clock: told what is done.
    """
    below = scene.means.astype(np.float64) @ up.direction < storey.head_height  # (N,)
    shown_rows = np.flatnonzero(below)
    shown = scene.select(shown_rows)
    plan = shown.means.astype(np.float64) @ up_frame(up.direction)[:2].T
    tiles = [tile for count in tile_counts(len(shown)) for tile in plan_tiles(plan, count)]
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
