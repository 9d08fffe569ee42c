"""The tables of the field: tasks of a data set before and after trimming, by both rules, below published figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from gaussian_trimmer.evaluation.clip_iqa import OVER_CROPS, PAIRS
from gaussian_trimmer.evaluation.layouts.layout import Layout
from gaussian_trimmer.evaluation.runs import Run
from gaussian_trimmer.evaluation.scoring import RULES, Scores, mean_scores
from gaussian_trimmer.evaluation.tables import Cell, Change, ScoreTable, heading, score_cells

_METRICS = {"iou": "IoU", "accuracy": "accuracy", "boundary_iou": "boundary IoU"}
_MEANS = {"iou": "mIoU (%)", "accuracy": "mAcc (%)", "boundary_iou": "mBIoU (%)"}
_LOOKS = "GaussianTrimmer, Table II"
_UNKNOWN_CLIP = "the paper names neither CLIP model nor prompts of its figures: compare within one source only"


def table_of_tasks(layout: Layout, method: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """A row for each task of one method, and the mean as the data set takes it."""
    names = [name + ending for ending in RULES.values() for name in _METRICS]
    rows: list[list[Cell]] = []
    for run in runs:
        label = run.object if run.object.startswith(run.scene) else f"{run.scene}/{run.object}"
        rows.append([label, run.views, *score_cells(names, run.before, run.after)])
    if layout.mean_by_scene:
        rows += [
            [f"{scene}, mean", None, *score_cells(names, *pair)] for scene, pair in _scene_means(layout, runs).items()
        ]
    rows.append(["mean", None, *score_cells(names, *mean_of(layout, runs))])
    columns = ["task", "views", *(f"{name} {rule} (%)" for rule in RULES for name in _METRICS.values())]
    title = f"{layout.title}: {method} before -> after trimming"
    return ScoreTable(title, columns, rows, [*notes, *_notes_on(layout, len(runs))])


def table_beside_published(
    layout: Layout, methods: Mapping[str, Sequence[Run]], notes: Sequence[str], protocol: str, rules: Sequence[str]
) -> ScoreTable:
    """Means of the methods, a row for each rule of occlusion, below what was published of the same protocol.

    Args:
        layout: the data set.
        methods: runs by method.
        notes: how they were measured.
        protocol: by which protocol.
        rules: the rules of occlusion that count by it.
    """
    published = [row for row in layout.published if row.protocol == protocol]
    rows: list[list[Cell]] = [
        [row.method, row.source, Change(row.iou, row.trimmed_iou), Change(row.second, row.trimmed_second)]
        for row in published
    ]
    for method, runs in methods.items():
        means = mean_of(layout, runs)
        for rule in rules:
            names = ["iou" + RULES[rule], layout.second + RULES[rule]]
            rows.append([method, f"measured, {rule}", *score_cells(names, *means)])
    columns = ["method", "figures", _MEANS["iou"], _MEANS[layout.second]]
    notes = [*notes, *_notes_on(layout, min(map(len, methods.values()), default=0))]
    others = sorted({str(row.protocol) for row in layout.published if row.protocol} - {protocol})
    if others:
        notes.append(f"published figures of other protocols are not comparable: --protocol {' or '.join(others)}")
    return ScoreTable(f"{layout.title} with and without trimming", columns, rows, notes, digits=1)


def table_of_looks(layout: Layout, methods: Mapping[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """CLIP-IQA of the methods' objects before and after trimming, below published figures."""
    rows: list[list[Cell]] = [
        [row.method, _LOOKS, *(Change(*pair) for pair in row.looks)] for row in layout.published if row.looks
    ]
    for way, ending in (("measured", ""), ("measured over crops", OVER_CROPS)):
        names = [name + ending for name in PAIRS]
        rows += [[name, way, *score_cells(names, *mean_of(layout, runs))] for name, runs in methods.items()]
    columns = ["method", "figures", *map(heading, PAIRS)]
    title = f"{layout.title}: CLIP-IQA with and without trimming"
    return ScoreTable(title, columns, rows, [*notes, _UNKNOWN_CLIP], digits=1)


def mean_of(layout: Layout, runs: Sequence[Run]) -> tuple[Scores, Scores]:
    """Scores before and after, averaged as the data set does."""
    if not layout.mean_by_scene:
        return _means(runs)
    before, after = zip(*_scene_means(layout, runs).values(), strict=True)
    return mean_scores(before), mean_scores(after)


def _scene_means(layout: Layout, runs: Sequence[Run]) -> dict[str, tuple[Scores, Scores]]:
    """Means of the objects of each scene, or of all views of its objects."""
    scenes = dict.fromkeys(run.scene for run in runs)
    counted = [run for run in runs for _ in range(run.views if layout.mean_by_view else 1)]
    return {scene: _means([run for run in counted if run.scene == scene]) for scene in scenes}


def _means(runs: Iterable[Run]) -> tuple[Scores, Scores]:
    runs = list(runs)
    return mean_scores(run.before for run in runs), mean_scores(run.after for run in runs)


def _notes_on(layout: Layout, n_tasks: int) -> list[str]:
    of_tasks = "the objects of a scene, then over scenes" if layout.mean_by_scene else "tasks"
    over = (
        "all objects in all views of a scene" if layout.mean_by_view else f"the views of a task, then over {of_tasks}"
    )
    notes = [f"means over {over}{', then over scenes' if layout.mean_by_view else ''}"]
    if n_tasks != layout.expected and layout.expected is not None:
        notes.append(
            f"{n_tasks} tasks, where {layout.title} has {layout.expected}: means are not comparable with published ones"
        )
    if not layout.published:
        notes.append("no published figures are recorded for this data set")
    return notes
