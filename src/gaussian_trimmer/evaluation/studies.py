"""The paper's studies: ablation of virtual camera planning and background augmentation, and the number of views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from gaussian_trimmer.evaluation.runs import Run, Task, measure
from gaussian_trimmer.evaluation.scoring import Judge, mean_scores
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable
from gaussian_trimmer.evaluation.variants import Variant

PUBLISHED_ABLATION = {
    "before trimming": (90.9, 98.3),
    "No VCP": (91.3, 98.3),
    "No background augmentation": (91.5, 98.4),
    "No VCP and BA": (91.3, 98.3),
    "Full GaussianTrimmer": (92.1, 98.5),
}
"""mIoU and mAcc of the paper, SAGA on NVOS."""
PUBLISHED_VIEW_COUNTS = {1: (256, 0.8), 2: (409, 0.9), 3: (521, 1.0), 5: (766, 1.2), 7: (1037, 1.2), 10: (1566, 1.2)}
"""Number of views -> latency in ms and gain in points of mIoU, of the paper: SAGA on NVOS, with SAM2 on a GPU."""


def measure_all(
    tasks: Iterable[Task], variants: Mapping[str, Variant], judge: Judge, report: Callable[[Run], None]
) -> list[Run]:
    """Trim every task in every way; `report` is told of each run."""
    runs = []
    for task in tasks:
        for run in measure(task, variants, [judge], fidelity=False):
            runs.append(run)
            report(run)
    return runs


def ablation_table(runs: Sequence[Run], variants: Sequence[str], notes: Sequence[str]) -> ScoreTable:
    """A row for each variant beside the paper's; the first row is the selection before trimming."""
    before = mean_scores(run.before for run in runs)
    rows: list[list[Cell]] = [_ablation_row("before trimming", before, None)]
    for name in variants:
        after = mean_scores(run.after for run in runs if run.variant == name)
        rows.append(_ablation_row(name, after, after["iou"] - before["iou"]))
    columns = ["method", "mIoU (%)", "mAcc (%)", "gain", "paper: mIoU (%)", "paper: mAcc (%)"]
    paper = "the paper's columns are of SAGA on NVOS; means over " + _amount(runs, len(variants))
    return ScoreTable("Ablation of virtual camera planning and background augmentation", columns, rows, [*notes, paper])


def _ablation_row(name: str, scores: Mapping[str, float], gain: float | None) -> list[Cell]:
    iou, accuracy = PUBLISHED_ABLATION.get(name, (None, None))
    return [name, scores["iou"], scores["accuracy"], gain, iou, accuracy]


def view_counts_table(runs: Sequence[Run], counts: Mapping[str, int], notes: Sequence[str]) -> ScoreTable:
    """Latency and gain by number of virtual views, beside the paper's.

    Args:
        counts: variant -> number of views.
    """
    rows: list[list[Cell]] = []
    for name, (n, latency, gain) in zip(counts, view_count_points(runs, counts), strict=True):
        paper = PUBLISHED_VIEW_COUNTS.get(counts[name], (None, None))
        rows.append([n, latency, gain, *paper])
    columns = ["views", "latency (ms)", "mIoU gain", "paper: latency (ms)", "paper: mIoU gain"]
    of_paper = "the paper's columns are of SAGA on NVOS; medians and means over " + _amount(runs, len(counts))
    return ScoreTable("Number of virtual views", columns, rows, [*notes, of_paper], digits=1)


def view_count_points(runs: Sequence[Run], counts: Mapping[str, int]) -> list[tuple[int, float, float]]:
    """Number of views, median latency in ms and mean gain in points of IoU, for each variant."""
    points = []
    for name, n in counts.items():
        chosen = [run for run in runs if run.variant == name]
        latency = 1e3 * float(np.median([run.seconds for run in chosen]))
        points.append((n, latency, float(np.mean([run.iou_change for run in chosen]))))
    return points


def _amount(runs: Sequence[Run], n_variants: int) -> str:
    return f"{len(runs) // max(n_variants, 1)} trims each"
