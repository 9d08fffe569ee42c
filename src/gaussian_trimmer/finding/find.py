"""From a scene to its objects: reads as the algorithm, and each step is a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.finding.found import FoundObject, FoundObjects
from gaussian_trimmer.finding.judging import FindConfig, Verdict, judge
from gaussian_trimmer.finding.regions import find_regions
from gaussian_trimmer.finding.room_surfaces import Room, find_room
from gaussian_trimmer.finding.visible_surface import VisibleSurface, find_visible_surface, views_of, with_hidden
from gaussian_trimmer.gaussians import SH_C0, Float64Array, Gaussians, IntArray
from gaussian_trimmer.planning.up_vector import find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer

_HIDDEN_REACH = 0.05
"""Distance, in units, up to which what does not show belongs to the visible Gaussian next to it."""


def find_objects(
    scene: Gaussians,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    config: FindConfig | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    progress: Callable[[str], None] = lambda stage: None,
) -> FoundObjects:
    """Every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Args:
        scene: all N Gaussians.
        cameras: the cameras that the scene was trained with, if known.
        up: the scene's up vector, (3,), if known.
        config: what counts as an object; the usual, if not given.
        renderer: a renderer, or the name of one.
        progress: called with the name of each step when it begins: `look`, once for each view, `surfaces`, `regions`.

    Raises:
        InputError: the up vector is none, or hardly anything shows in the views.
    """
    steps, config = _Steps(progress), config or FindConfig()
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    found_up = find_up(scene, cameras, up)
    with steps("look"):
        views = views_of(scene, cameras, found_up.direction)
        surface = find_visible_surface(scene, views, found_up.direction, renderer, lambda: progress("look"))
    with steps("surfaces"):
        room = find_room(surface)
    with steps("regions"):
        regions = find_regions(surface, room)
        verdicts = judge(surface, room, regions, config)
    labels, objects = _labelled(scene, surface, room, regions, verdicts, config)
    return FoundObjects(scene, labels, objects, found_up, steps.seconds)


def _labelled(
    scene: Gaussians,
    surface: VisibleSurface,
    room: Room,
    regions: IntArray,
    verdicts: list[Verdict],
    config: FindConfig,
) -> tuple[NDArray[np.int64], tuple[FoundObject, ...]]:
    """Number of the object that each Gaussian of the scene belongs to, (N,), and the objects."""
    numbers = np.zeros(len(surface.rows), np.int64)
    for number, verdict in enumerate(verdicts, 1):
        numbers[regions == verdict.region] = number
    if config.surfaces:
        for number, one in enumerate(room.surfaces, len(verdicts) + 1):
            numbers[(regions < 0) & one.own & (numbers == 0)] = number
    labels = with_hidden(surface, scene, numbers, _HIDDEN_REACH)
    counts = np.bincount(labels, minlength=len(verdicts) + len(room.surfaces) + 1)
    objects = [
        _described(scene, surface, labels, number, verdict, int(counts[number]))
        for number, verdict in enumerate(verdicts, 1)
    ]
    if config.surfaces:
        for number, one in enumerate(room.surfaces, len(verdicts) + 1):
            rows = np.flatnonzero(numbers == number)
            if len(rows):
                points = surface.points[rows]
                kind = "horizontal" if one.horizontal else "upright"
                shown = surface.shown[:, rows]
                verdict = Verdict(
                    -1,
                    float(shown.sum() / max(float(surface.shown.sum()), 1e-12)),
                    1.0,
                    (points.min(axis=0), points.max(axis=0)),
                    1.0,
                    f"a {kind} surface of the room",
                )
                objects.append(_described(scene, surface, labels, number, verdict, int(counts[number]), "surface"))
    return labels, tuple(objects)


def _described(
    scene: Gaussians,
    surface: VisibleSurface,
    labels: NDArray[np.int64],
    number: int,
    verdict: Verdict,
    count: int,
    kind: str = "object",
) -> FoundObject:
    low, high = verdict.box
    colour: Float64Array = np.clip(0.5 + SH_C0 * scene.sh_dc[labels == number].mean(axis=0, dtype=np.float64), 0, 1)
    return FoundObject(
        id=number,
        kind=kind,
        centre=surface.centre + surface.unit * (low + high) / 2 @ surface.axes,
        size=surface.unit * (high - low),
        colour=colour,
        gaussians=count,
        shown=verdict.shown,
        seen=verdict.seen,
        confidence=verdict.confidence,
        why=verdict.why,
    )


class _Steps:
    """Times steps, and says that they begin."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        self._progress, self.seconds = progress, dict[str, float]()

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self._progress(name)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
