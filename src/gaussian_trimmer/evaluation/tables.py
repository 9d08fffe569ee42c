"""Tables of scores as Markdown, CSV, JSON and LaTeX, with notes on how they were measured, and how sure means are.

CSV has no notes, since most readers take every line for a row; they are written beside it.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import printable
from gaussian_trimmer.evaluation.datasets import MeanOver
from gaussian_trimmer.evaluation.scoring import ACC25, METRICS, Scores, mean_scores
from gaussian_trimmer.evaluation.trials import LOSS, Run

MADE_BY = f"made by gaussian-trimmer {__version__}"
"""A note of every table."""
_LEAST_CAPTURES = 5
"""Captures below which a mean has no interval: from fewer it would be too wide to say anything."""
_LATEX: Mapping[str, str] = {
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}",
    "<": "$<$", ">": "$>$", "[": "{[}",
}  # fmt: skip
"""Character that LaTeX would obey or not show -> how it is written; after a line's end a bracket is an option."""
ENDINGS = {"table": ".md", "csv": ".csv", "json": ".json", "latex": ".tex"}
"""Ending of the file of each format."""

Cell = str | float | int | tuple[float | None, ...] | None
"""Two numbers are a score before and after, three a mean with the ends of its 95 % interval."""
_PARTS: Mapping[int, tuple[str, ...]] = {1: ("",), 2: ("before", "after"), 3: ("mean", "low", "high")}


@dataclass(frozen=True)
class ScoreTable:
    """Rows of cells below headings, with a title, and notes on how the figures were measured."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()
    digits: int = 2
    """Decimals of numbers in Markdown and LaTeX; CSV and JSON have four."""
    for_papers: ScoreTable | None = None
    """What LaTeX shows in its place."""

    def text(self, format: str) -> str:
        """Return the table in one of the formats of `ENDINGS`."""
        if format in ("csv", "json"):
            return self._as_csv() if format == "csv" else json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n"
        if format == "latex" and self.for_papers is not None:
            return self.for_papers.text(format)
        cells = [[cell_text(cell, self.digits) for cell in row] for row in self.rows]
        return self._as_latex(cells) if format == "latex" else self._as_markdown(cells)

    def as_dict(self) -> dict[str, Any]:
        """Return the table as JSON holds it: rows are objects, in which each number of a cell has its own name."""
        columns = zip(*self.rows, strict=True)
        sizes = [max(len(cell) if isinstance(cell, tuple) else 1 for cell in column) for column in columns]
        rows = []
        for row in self.rows:
            flat: dict[str, str | float | int | None] = {}
            for name, cell, n in zip(self.columns, row, sizes, strict=True):
                values = cell if isinstance(cell, tuple) else (cell,) * n
                for part, value in zip(_PARTS[n], values, strict=True):
                    flat[f"{name} {part}".strip()] = round(value, 4) if isinstance(value, float) else value
            rows.append(flat)
        return {"title": self.title, "notes": list(self.notes), "rows": rows}

    def _as_csv(self) -> str:
        file, rows = io.StringIO(), self.as_dict()["rows"]
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([rows[0], *(["" if v is None else cell_text(v, 4) for v in row.values()] for row in rows)])
        return file.getvalue()

    def _as_markdown(self, cells: list[list[str]]) -> str:
        lines = [list(self.columns), *cells]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * widths[0], *(f"{'-' * (width - 1)}:" for width in widths[1:])])
        drawn = [
            [
                text.rjust(width) if place else text.ljust(width)
                for place, (text, width) in enumerate(zip(line, widths, strict=True))
            ]
            for line in lines
        ]
        return "\n".join([self.title, "", *(f"| {' | '.join(line)} |" for line in drawn), "", *self.notes, ""])

    def _as_latex(self, cells: list[list[str]]) -> str:
        """Return a tabular that needs no package, below title and notes as comments (`%`)."""
        rows = [
            [_escaped(text) if isinstance(cell, str) else _mathematics(text) for cell, text in zip(*pair, strict=True)]
            for pair in zip(self.rows, cells, strict=True)
        ]
        head, *body = (f"{' & '.join(line)} \\\\" for line in [list(map(_escaped, self.columns)), *rows])
        comments = [f"% {printable(comment)}" for comment in (self.title, *self.notes)]
        begin = f"\\begin{{tabular}}{{l{'r' * (len(self.columns) - 1)}}}"
        return "\n".join([*comments, begin, "\\hline", head, "\\hline", *body, "\\hline", "\\end{tabular}", ""])


def write_tables(
    tables: Mapping[str, ScoreTable], runs: Sequence[Run], settings: Mapping[str, Any], folder: Path
) -> None:
    """Write tables by name in every format, `runs.json` if there are runs, and `settings.json`: all that was set."""
    documents: dict[str, Any] = {"runs": [asdict(run) for run in runs]} if runs else {}
    about = {name: {"title": table.title, "notes": list(table.notes)} for name, table in tables.items()}
    documents["settings"] = {"made_by": MADE_BY, **settings, "tables": about}
    for name, document in documents.items():
        (folder / f"{name}.json").write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    for name, table in tables.items():
        for format, ending in ENDINGS.items():
            (folder / f"{name}{ending}").write_text(table.text(format), encoding="utf-8")


def known_metrics(*scores: Scores) -> list[str]:
    """Return the metrics that some of the scores have, in the order of tables; without shares of masks."""
    return [name for name in METRICS if name not in ACC25 and any(name in score for score in scores)]


def heading(metric: str) -> str:
    """Return a metric with its unit.

    >>> heading("psnr")
    'extraction PSNR (dB)'
    """
    return f"{METRICS[metric]} {'(dB)' if metric in ('psnr', 'fidelity') else '(%)'}"


def score_cells(metrics: Sequence[str], before: Scores | None, after: Scores) -> list[Cell]:
    """Return a cell for each metric; a number if there is nothing before. Fidelity has no before."""
    return [
        after.get(name) if before is None or name == "fidelity" else (before.get(name), after.get(name))
        for name in metrics
    ]


def cell_text(cell: Cell, digits: int) -> str:
    """Return a cell as text, numbers with some decimals.

    >>> cell_text((1.0, 2.0), 1), cell_text((1.0, 0.5, 2.0), 1), cell_text(None, 1)
    ('1.0 -> 2.0', '1.0 [0.5, 2.0]', '-')
    """
    match cell:
        case (before, after):
            return f"{cell_text(before, digits)} -> {cell_text(after, digits)}"
        case (mean, None, None):
            return cell_text(mean, digits)
        case (mean, low, high):
            return f"{cell_text(mean, digits)} [{cell_text(low, digits)}, {cell_text(high, digits)}]"
        case None:
            return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


def _mathematics(text: str) -> str:
    """Return numbers as LaTeX sets them: with signs as long as they should be, and arrows."""
    if text == "-":
        return "--"
    return re.sub(r"-?\d+(\.\d+)?", r"$\g<0>$", text.replace("-> ", r"$\to$ ").replace("- ", "-- "))


def _escaped(text: str) -> str:
    r"""Return text whose special characters are escaped for LaTeX.

    >>> _escaped("mIoU (%), a_b")
    'mIoU (\\%), a\\_b'
    """
    return "".join(_LATEX.get(character, character) for character in printable(text))


def unit_scores(runs: Sequence[Run], over: MeanOver) -> dict[str, tuple[Scores, Scores]]:
    """Return the mean scores before and after of each object or scene, by its name."""
    units: dict[str, list[Run]] = {}
    for run in runs:
        name = f"{run.scene}/{run.object}" if over == "objects" else run.scene
        units.setdefault(name, []).extend([run] * (run.views if over == "scenes, by view" else 1))
    return {
        name: (mean_scores(r.before for r in own), mean_scores(r.after for r in own)) for name, own in units.items()
    }


def interval_of(
    values: Sequence[float], captures: Sequence[str] | None = None
) -> tuple[float, float | None, float | None]:
    """Return the mean of values with the ends of its 95 % t interval, which are not known for fewer than five captures.

    Values of one capture share its errors: their deviations from the mean are summed before they are squared.

    >>> interval_of([1.0, 1.0, 1.0, 1.0, 1.0])
    (1.0, 1.0, 1.0)

    Args:
        values: scores or gains.
        captures: the capture that each comes of; without it, each comes of its own.
    """
    from scipy.special import stdtrit  # takes longer to import than a command to start, and only intervals need it

    mean = float(np.mean(values))
    _, capture = np.unique(range(len(values)) if captures is None else list(captures), return_inverse=True)
    summed = np.bincount(capture, np.asarray(values, np.float64) - mean)
    if (n := len(summed)) < _LEAST_CAPTURES:
        return mean, None, None
    half = float(stdtrit(n - 1, 0.975) * np.sqrt(n / (n - 1) * np.sum(summed**2)) / len(values))
    return mean, mean - half, mean + half


def table_of_methods(
    title: str,
    methods: Mapping[str, Sequence[Run]],
    metrics: Mapping[str, Sequence[str]],
    notes: Sequence[str],
    mean_over: MeanOver = "objects",
) -> ScoreTable:
    """Return a row for each method and rule, with the metrics of the rule: means, with the trim, and its gain.

    A metric has one number where nothing is known before a trim. Intervals are those of `table_of_statistics`.
    """
    trimmed = any(run.before for runs in methods.values() for run in runs)
    rows: list[list[Cell]] = []
    for method, runs in methods.items():
        units = unit_scores(runs, mean_over)
        before, after = (mean_scores(pair[when] for pair in units.values()) for when in (0, 1))
        for rule, names in metrics.items():
            row: list[Cell] = [method, rule]
            for name in names:
                gains = {
                    unit: now[name] - was[name] for unit, (was, now) in units.items() if name in was and name in now
                }
                captures = [unit.partition("/")[0] for unit in gains]
                gain = interval_of(list(gains.values()), captures) if gains else None
                row += [before.get(name), after.get(name), gain] if trimmed else [after.get(name)]
            rows.append(row)
    parts = [
        [heading(name), f"{METRICS[name]} + ours", f"{METRICS[name]} gain"] for name in next(iter(metrics.values()))
    ]
    columns = ["method", "rule", *(column for part in parts for column in (part if trimmed else part[:1]))]
    return ScoreTable(title, columns, rows, notes)


def table_of_statistics(
    title: str,
    methods: Mapping[str, Sequence[Run]],
    metrics: Sequence[str],
    notes: Sequence[str],
    mean_over: MeanOver = "objects",
    capture_of: Callable[[str], str] = str,
) -> ScoreTable:
    """Return a row for each method and metric: before, after and gain with intervals, how many trims lose, the worst.

    Args:
        title: title of the table.
        methods: the runs of each method.
        metrics: names of metrics.
        notes: notes on how scores were measured.
        mean_over: what a mean is taken over.
        capture_of: returns the name of the capture that a scene comes of.
    """
    units = mean_over.partition(",")[0]
    rows: list[list[Cell]] = []
    for method, runs in methods.items():
        scores = unit_scores(runs, mean_over)
        for name in (name for name in metrics if any(name in after for _, after in scores.values())):
            known = {unit: (before[name], after[name]) for unit, (before, after) in scores.items() if name in after}
            captures = [capture_of(unit.partition("/")[0]) for unit in known]
            befores, afters = zip(*known.values(), strict=True)
            worst = min((run for run in runs if name in run.after), key=lambda run: run.gain(name))
            rule = "iou_in_scene" if name.endswith("in_scene") else "iou"
            gains = [after - before for before, after in zip(befores, afters, strict=True)]
            losing = sum(run.loses(rule) for run in runs if name in run.after)
            intervals = [interval_of(values, captures) for values in (befores, afters, gains)]
            rows.append([method, METRICS[name], len(known), len(set(captures)), *intervals, losing,
                         worst.gain(name), f"{worst.scene}/{worst.object}"])  # fmt: skip
    columns = ["method", "metric", units, "captures", "before", "after", "gain", "losing", "worst gain", "worst object"]
    own = [
        f"means over {units} with 95 % t intervals, whose units are captures; none below {_LEAST_CAPTURES} captures",
        f"gain: after - before of the same {units}; losing: trims that gain less than -{LOSS} points of IoU, by that "
        "rule",
    ]
    return ScoreTable(title, columns, rows, [*own, *notes])
