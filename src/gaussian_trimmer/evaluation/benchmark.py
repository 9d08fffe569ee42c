"""The trimming benchmark: every scene x object x kind of rough selection becomes a task; means by kind and by scene.

No ground truth reaches the trimmer: it gets the scene, the selection and, where the scene has them, the up vector and
the training cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.evaluation.datasets import BenchmarkScene, find_scenes, open_scene
from gaussian_trimmer.evaluation.results import cut_by
from gaussian_trimmer.evaluation.runs import LOSS, Run, Task
from gaussian_trimmer.evaluation.scoring import mean_scores
from gaussian_trimmer.evaluation.tables import Cell, Change, ScoreTable, heading, known_metrics
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.geometry.bounds import up_frame

_SMALLEST_SELECTION = 0.1
"""Share of the Gaussians of `exact`; nobody would start from selections with fewer, which are left out."""
_BOX_MARGIN = 0.1
"""Width that the kind `box` adds around an object, in radii."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """What of a benchmark is measured."""

    objects: tuple[str, ...] = ()
    """Only these objects."""
    kinds: tuple[str, ...] = ()
    """Only these kinds of rough selection; `box` is a box around the object, wider by a tenth of its radius."""
    without_cameras: bool = False
    """Give the trimmer neither cameras nor up vector."""
    all_views: bool = False
    """Count far test views as well."""


def benchmark_tasks(
    root: Path, options: BenchmarkOptions, left_out: Callable[[str], None] = lambda what: None
) -> Iterator[Task]:
    """The tasks of all scenes at or directly in a folder.

    Args:
        left_out: is told of selections that are too small to start from.

    Raises:
        InputError: a scene cannot be used.
    """
    for folder in find_scenes(root):
        scene = open_scene(folder)
        for name in scene.objects:
            if not options.objects or name in options.objects:
                yield from _tasks_of(scene, name, options, left_out)


def _tasks_of(
    scene: BenchmarkScene, name: str, options: BenchmarkOptions, left_out: Callable[[str], None]
) -> Iterator[Task]:
    cameras = None if options.without_cameras else only_training(read_camera_set(scene.cameras_file))
    up = None if scene.up is None or options.without_cameras else tuple(scene.up.tolist())
    views = [view for view in scene.test_views(name) if options.all_views or not view.far]
    for kind in options.kinds or scene.coarse_kinds(name):
        selection = _box(scene, name) if kind == "box" else scene.coarse(name, kind)
        if _too_few(scene, name, kind, selection):
            left_out(f"{scene.name}/{name} {kind}, {selection.sum()} Gaussians")
            continue
        before = cut_by(scene.gaussians, selection)
        yield Task(scene.name, name, kind, scene.gaussians, selection, before, views, cameras, up)


def _too_few(scene: BenchmarkScene, name: str, kind: str, selection: BoolArray) -> bool:
    """Whether the selection holds less than a tenth of what the kind `exact` holds."""
    if kind == "exact" or "exact" not in scene.coarse_kinds(name):
        return False
    return bool(selection.sum() < _SMALLEST_SELECTION * scene.coarse(name, "exact").sum())


def _box(scene: BenchmarkScene, name: str) -> BoolArray:
    """What an upright box around the object holds: percentiles 1 to 99 of its centres, and a margin in radii."""
    axes = up_frame(scene.up if scene.up is not None else np.array([0.0, -1.0, 0.0]))
    positions = scene.gaussians.means @ axes.T
    low, high = np.percentile(positions[scene.coarse(name, "exact")], [1, 99], axis=0)
    reach = _BOX_MARGIN * np.linalg.norm(high - low) / 2
    return np.asarray(((positions > low - reach) & (positions < high + reach)).all(axis=1))


def table_of_kinds(variant: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Means by kind of rough selection."""
    kinds = [(kind, [run for run in runs if run.kind == kind]) for kind in sorted({run.kind for run in runs})]
    return _table(f"{variant}, by kind of selection", "selection", [*kinds, ("all", list(runs))], notes)


def table_of_scenes(variant: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Means by scene."""
    scenes = [(scene, [run for run in runs if run.scene == scene]) for scene in sorted({run.scene for run in runs})]
    return _table(f"{variant}, by scene", "scene", [*scenes, ("all", list(runs))], notes)


def table_of_runs(variant: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Every run."""
    rows = [(f"{run.scene}/{run.object} {run.kind}", [run]) for run in runs]
    return _table(f"{variant}, every trim", "trim", rows, notes)


def _table(title: str, first: str, groups: Sequence[tuple[str, list[Run]]], notes: Sequence[str]) -> ScoreTable:
    everything = groups[-1][1]
    metrics = known_metrics(*(run.after for run in everything))
    columns = [
        first,
        "trims",
        *map(heading, metrics),
        "worst IoU change",
        "losses",
        "refused",
        heading("fidelity"),
        "s",
    ]
    rows: list[list[Cell]] = []
    for name, runs in groups:
        before, after = mean_scores(run.before for run in runs), mean_scores(run.after for run in runs)
        worst = min(runs, key=lambda run: run.iou_change)
        fidelity = float(np.mean([run.fidelity for run in runs]))
        rows.append([
            name, len(runs), *(Change(before.get(metric), after.get(metric)) for metric in metrics),
            f"{worst.iou_change:+.2f} {worst.object} {worst.kind}", sum(run.loses for run in runs),
            sum(bool(run.refused) for run in runs), None if np.isnan(fidelity) else fidelity,
            float(np.median([run.seconds for run in runs])),
        ])  # fmt: skip
    loss = f"A loss is more than {LOSS:g} points of IoU; s is the median time of a trim"
    return ScoreTable(title, columns, rows, [*notes, loss])
