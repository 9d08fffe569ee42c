"""How sure the means over objects are: bootstrap intervals, paired differences, and the trims that lose."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.evaluation.runs import LOSS, Run
from gaussian_trimmer.evaluation.scoring import METRICS
from gaussian_trimmer.evaluation.tables import Cell, Interval, ScoreTable

_ROUNDS = 10_000
_ENDS = (2.5, 97.5)
_NOTES = (
    f"means over objects with 95 % intervals: percentiles of {_ROUNDS} bootstrap samples of the objects, seed 0",
    f"gain: after - before of the same object; losing: trims that gain less than -{LOSS} points of IoU, by that rule",
)


def interval_of(values: Sequence[float]) -> Interval:
    """The mean of values with its 95 % interval, which is not known for less than two.

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
    title: str, methods: Mapping[str, Sequence[Run]], metrics: Sequence[str], notes: Sequence[str]
) -> ScoreTable:
    """A row for each method and metric: before, after and gain with intervals, how many trims lose, and the worst."""
    rows: list[list[Cell]] = []
    for method, runs in methods.items():
        for name in metrics:
            trimmed = [run for run in runs if name in run.after]
            before, after = _by_object(runs, name, "before"), _by_object(trimmed, name, "after")
            if not before:
                continue
            row: list[Cell] = [method, METRICS[name], len(before), interval_of([*before.values()])]
            if trimmed:
                worst = min(trimmed, key=lambda run: run.gain(name))
                rule = "iou_in_scene" if name.endswith("in_scene") else "iou"
                gains = [value - before[key] for key, value in after.items()]
                row += [interval_of([*after.values()]), interval_of(gains), sum(run.loses(rule) for run in trimmed)]
                row += [worst.gain(name), f"{worst.scene}/{worst.object}"]
            rows.append([*row, *[None] * (9 - len(row))])
    columns = ["method", "metric", "objects", "before", "after", "gain", "losing", "worst gain", "worst object"]
    return ScoreTable(title, columns, rows, [*_NOTES, *notes])


def _by_object(runs: Sequence[Run], metric: str, when: str) -> dict[tuple[str, str], float]:
    """The mean score of each object, by scene and name, over its runs that have it."""
    scores: dict[tuple[str, str], list[float]] = {}
    for run in runs:
        if metric in getattr(run, when):
            scores.setdefault((run.scene, run.object), []).append(getattr(run, when)[metric])
    return {key: float(np.mean(values)) for key, values in scores.items()}


@cache
def made_by() -> str:
    """The program's version and, where it is known, the commit."""
    return f"made by gaussian-trimmer {__version__}{f', commit {commit}' if (commit := _commit()) else ''}"


def _commit() -> str | None:
    """The commit of the checkout that is used, or that pip installed from."""
    checkout = Path(__file__).resolve().parents[3]
    if (checkout / ".git").exists():
        command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        with suppress(OSError, subprocess.SubprocessError):
            return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    with suppress(metadata.PackageNotFoundError, ValueError, KeyError, TypeError):
        url = json.loads(metadata.distribution("gaussian-trimmer").read_text("direct_url.json") or "")
        return str(url["vcs_info"]["commit_id"])[:12]
    return None
