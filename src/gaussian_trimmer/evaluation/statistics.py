"""How sure means are: bootstrap intervals, paired differences, and the trims that lose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gaussian_trimmer.evaluation.runs import LOSS, MeanOver, Run, unit_scores
from gaussian_trimmer.evaluation.scoring import METRICS
from gaussian_trimmer.evaluation.tables import Cell, Interval, ScoreTable

_ROUNDS = 10_000
_ENDS = (2.5, 97.5)


def interval_of(values: Sequence[float]) -> Interval:
    """Return the mean of values with its 95 % interval, which is not known for less than two.

    >>> interval_of([1.0, 1.0, 1.0])
    Interval(mean=1.0, low=1.0, high=1.0)
    """
    numbers = np.asarray(values, np.float64)
    if len(numbers) < 2:
        return Interval(float(numbers.mean()), None, None)
    drawn = np.random.default_rng(0).integers(0, len(numbers), (_ROUNDS, len(numbers)))
    low, high = np.percentile(numbers[drawn].mean(axis=1), _ENDS)
    return Interval(float(numbers.mean()), float(low), float(high))


def table_of_statistics(
    title: str,
    methods: Mapping[str, Sequence[Run]],
    metrics: Sequence[str],
    notes: Sequence[str],
    mean_over: MeanOver = "objects",
) -> ScoreTable:
    """Return a row for each method and metric: before, after and gain with intervals, how many trims lose, the worst.

    What is resampled is what the mean is taken over.
    """
    units = mean_over.partition(",")[0]
    rows: list[list[Cell]] = []
    for method, runs in methods.items():
        scores = unit_scores(runs, mean_over).values()
        for name in metrics:
            befores = [before[name] for before, _ in scores if name in before]
            pairs = [(before[name], after[name]) for before, after in scores if name in after and name in before]
            row: list[Cell] = [method, METRICS[name], len(befores), interval_of(befores)] if befores else []
            if pairs:
                worst = min((run for run in runs if name in run.after), key=lambda run: run.gain(name))
                rule = "iou_in_scene" if name.endswith("in_scene") else "iou"
                row += [interval_of([after for _, after in pairs]), interval_of([now - then for then, now in pairs])]
                row += [sum(run.loses(rule) for run in runs if name in run.after), worst.gain(name)]
                row += [f"{worst.scene}/{worst.object}"]
            if row:
                rows.append([*row, *[None] * (9 - len(row))])
    columns = ["method", "metric", units, "before", "after", "gain", "losing", "worst gain", "worst object"]
    own = [
        f"means over {units} with 95 % intervals: percentiles of {_ROUNDS} bootstrap samples of the {units}, seed 0",
        f"gain: after - before of the same {units}; losing: trims that gain less than -{LOSS} points of IoU, by that "
        "rule",
    ]
    return ScoreTable(title, columns, rows, [*own, *notes])
