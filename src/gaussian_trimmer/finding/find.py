"""From a scene to its objects: reads as the algorithm, and each step is a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.finding.contacts import one_thing
from gaussian_trimmer.finding.found import FoundObject, FoundObjects
from gaussian_trimmer.finding.judging import FindConfig, Verdict, judge, judge_surface
from gaussian_trimmer.finding.model_masks import AskedModel
from gaussian_trimmer.finding.regions import find_regions
from gaussian_trimmer.finding.room_surfaces import Room, find_room
from gaussian_trimmer.finding.visible_surface import VisibleSurface, find_visible_surface, views_of, with_hidden
from gaussian_trimmer.gaussians import SH_C0, Gaussians, IntArray
from gaussian_trimmer.planning.up_vector import find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.selecting.model_masks import PromptableModel

_HIDDEN_REACH = 0.05
"""Distance, in units, up to which what does not show belongs to the visible Gaussian next to it."""


def find_objects(
    scene: Gaussians,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    config: FindConfig | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    segmenter: PromptableModel | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> FoundObjects:
    """Every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Args:
        scene: all N Gaussians.
        cameras: the cameras that the scene was trained with, if known.
        up: the scene's up vector, (3,), if known.
        config: what counts as an object; the usual, if not given.
        renderer: a renderer, or the name of one.
        segmenter: a model that draws masks for clicks, such as `SamSegmenter`. Things that touch are likelier one where
            its masks take both; without it their contact, colours and size alone tell.
        progress: called with the name of each step when it begins: `look`, and `look 1/16` and so on for its views,
            `surfaces`, `regions`.

    Raises:
        InputError: the up vector is none, hardly anything shows in the views, or the model cannot be run.
    """
    steps, config = _Steps(progress), config or FindConfig()
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    found_up = find_up(scene, cameras, up)
    with steps("look"):
        views = views_of(scene, cameras, found_up.direction)
        surface = find_visible_surface(
            scene, views, found_up.direction, renderer, lambda number: progress(f"look {number}/{len(views)}")
        )
    with steps("surfaces"):
        room = find_room(surface)
    with steps("regions"):
        asked = AskedModel(scene, surface, views, segmenter, renderer) if segmenter is not None else None
        regions = find_regions(surface, room, asked or one_thing)
        labels, objects = name_objects(scene, surface, room, regions, config)
    return FoundObjects(scene, labels, objects, tuple(views), surface, found_up, steps.seconds)


def name_objects(
    scene: Gaussians, surface: VisibleSurface, room: Room, regions: IntArray, config: FindConfig
) -> tuple[IntArray, tuple[FoundObject, ...]]:
    """Number of the object that each Gaussian of the scene belongs to, 0 for none, (N,), and the objects.

    Args:
        scene: all N Gaussians.
        surface: what shows of it, S Gaussians.
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
    labels = with_hidden(surface, scene, numbers, _HIDDEN_REACH)
    return labels, tuple(
        _described(scene, surface, labels, number, verdict) for number, verdict in enumerate(verdicts, 1)
    )


def _described(
    scene: Gaussians, surface: VisibleSurface, labels: IntArray, number: int, verdict: Verdict
) -> FoundObject:
    """One object as users know it."""
    (low, high), rows = verdict.box, np.flatnonzero(labels == number)
    colour = np.clip(0.5 + SH_C0 * scene.sh_dc[rows].mean(axis=0, dtype=np.float64), 0, 1)
    return FoundObject(
        id=number,
        kind="object" if verdict.region is not None else "surface",
        centre=surface.centre + surface.unit * (low + high) / 2 @ surface.axes,
        size=surface.unit * (high - low),
        colour=np.asarray(colour, np.float64),
        gaussians=len(rows),
        shown=verdict.shown,
        seen=verdict.seen,
        view=verdict.view,
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
