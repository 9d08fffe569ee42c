"""The tables of the field: tasks of a data set before and after trimming, by both rules, below published figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gaussian_trimmer.evaluation.clip_iqa import OVER_CROPS, PAIRS
from gaussian_trimmer.evaluation.layouts import Layout
from gaussian_trimmer.evaluation.protocols import Protocol
from gaussian_trimmer.evaluation.runs import MeanOver, Run, unit_scores
from gaussian_trimmer.evaluation.scoring import RULES, Scores, mean_scores
from gaussian_trimmer.evaluation.tables import BeforeAfter, Cell, ScoreTable, heading, score_cells

_METRICS = {"iou": "IoU", "accuracy": "accuracy", "boundary_iou": "boundary IoU"}
_MEANS = {"iou": "mIoU (%)", "accuracy": "mAcc (%)", "boundary_iou": "mBIoU (%)", "acc25": "Acc@0.25 (%)"}
_MEAN_NOTES: Mapping[MeanOver, str] = {
    "objects": "means over the views of a task, then over tasks",
    "scenes": "means over the views of a task, then over the objects of a scene, then over scenes",
    "scenes, by view": "means over all objects in all views of a scene, then over scenes",
}
_LOOKS = "GaussianTrimmer, Table II"
_UNKNOWN_CLIP = "the paper names neither CLIP model nor prompts of its figures: compare within one source only"


def table_of_tasks(layout: Layout, method: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Return a row for each task of one method, and the mean as the data set takes it."""
    metrics = {**_METRICS, **({"acc25": "Acc@0.25"} if layout.second == "acc25" else {})}
    names = [name + ending for ending in RULES.values() for name in metrics]
    rows: list[list[Cell]] = []
    for run in runs:
        label = run.object if run.object.startswith(run.scene) else f"{run.scene}/{run.object}"
        rows.append([label, run.views, *score_cells(names, run.before, run.after)])
    if layout.mean_over != "objects":
        scenes = unit_scores(runs, layout.mean_over)
        rows += [[f"{scene}, mean", None, *score_cells(names, *pair)] for scene, pair in scenes.items()]
    rows.append(["mean", None, *score_cells(names, *mean_of(layout, runs))])
    columns = ["task", "views", *(f"{name} {rule} (%)" for rule in RULES for name in metrics.values())]
    title = f"{layout.title}: {method} before -> after trimming"
    return ScoreTable(title, columns, rows, [*notes, *_notes_on(layout, len(runs))])


def table_beside_published(
    layout: Layout, methods: Mapping[str, Sequence[Run]], notes: Sequence[str], protocol: Protocol
) -> ScoreTable:
    """Return means of the methods, a row for each rule of occlusion, below what was published of the same protocol."""
    rows: list[list[Cell]] = [
        [row.method, row.source, BeforeAfter(*row.iou), BeforeAfter(*row.second) if row.second else None]
        for row in layout.published
        if row.protocol == protocol.name
    ]
    for method, runs in methods.items():
        means = mean_of(layout, runs)
        for rule in protocol.rules:
            names = ["iou" + RULES[rule], layout.second + RULES[rule]]
            rows.append([method, f"measured, {rule}", *score_cells(names, *means)])
    columns = ["method", "figures", _MEANS["iou"], _MEANS[layout.second]]
    notes = [*notes, *_notes_on(layout, min(map(len, methods.values()), default=0))]
    others = sorted({str(row.protocol) for row in layout.published if row.protocol} - {protocol.name})
    if others:
        notes.append(f"published figures of other protocols are not comparable: --protocol {' or '.join(others)}")
    return ScoreTable(f"{layout.title} with and without trimming", columns, rows, notes, digits=1)


def table_of_looks(layout: Layout, methods: Mapping[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """Return CLIP-IQA of the methods' objects before and after trimming, below published figures."""
    rows: list[list[Cell]] = [
        [row.method, _LOOKS, *(BeforeAfter(*pair) for pair in row.looks)] for row in layout.published if row.looks
    ]
    for way, ending in (("measured", ""), ("measured over crops", OVER_CROPS)):
        names = [name + ending for name in PAIRS]
        rows += [[name, way, *score_cells(names, *mean_of(layout, runs))] for name, runs in methods.items()]
    columns = ["method", "figures", *map(heading, PAIRS)]
    title = f"{layout.title}: CLIP-IQA with and without trimming"
    return ScoreTable(title, columns, rows, [*notes, _UNKNOWN_CLIP], digits=1)


def mean_of(layout: Layout, runs: Sequence[Run]) -> tuple[Scores, Scores]:
    """Return scores before and after, averaged as the data set does."""
    units = unit_scores(runs, layout.mean_over).values()
    return mean_scores(before for before, _ in units), mean_scores(after for _, after in units)


def _notes_on(layout: Layout, n_tasks: int) -> list[str]:
    notes = [_MEAN_NOTES[layout.mean_over]]
    if n_tasks != layout.expected and layout.expected is not None:
        notes.append(
            f"{n_tasks} tasks, where {layout.title} has {layout.expected}: means are not comparable with published ones"
        )
    if not layout.published:
        notes.append("no published figures are recorded for this data set")
    return notes
