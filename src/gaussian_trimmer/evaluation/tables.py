"""Tables of scores as Markdown, CSV, JSON and LaTeX, with notes on how their figures were measured.

CSV has no notes, since most readers take every line for a row; they are written beside it.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gaussian_trimmer.errors import printable
from gaussian_trimmer.evaluation.scoring import ACC25, METRICS, Scores


@dataclass(frozen=True)
class BeforeAfter:
    """A score before and after; None where it is not known."""

    before: float | None
    after: float | None


@dataclass(frozen=True)
class Interval:
    """A mean with the ends of its 95 % interval; None where these are not known."""

    mean: float
    low: float | None
    high: float | None


_LATEX: Mapping[str, str] = {
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}",
    "<": "$<$", ">": "$>$", "[": "{[}",
}  # fmt: skip
"""Character that LaTeX would obey or not show -> how it is written; after a line's end a bracket is an option."""

Cell = str | float | int | BeforeAfter | Interval | None
_PARTS: Mapping[type, tuple[str, ...]] = {BeforeAfter: ("before", "after"), Interval: ("mean", "low", "high")}
"""Cells that are several numbers -> the names of these."""


@dataclass(frozen=True)
class ScoreTable:
    """Rows of cells below headings, with a title, and notes on how the figures were measured."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()
    digits: int = 2
    """Decimals of numbers in Markdown and LaTeX; CSV and JSON have four."""

    def as_markdown(self) -> str:
        """Return a Markdown table with aligned columns."""
        lines = [list(self.columns), *([cell_text(cell, self.digits) for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        first, *others = widths
        lines.insert(1, ["-" * first, *(f"{'-' * (width - 1)}:" for width in others)])
        drawn = (
            [line[0].ljust(first), *(text.rjust(width) for text, width in zip(line[1:], others, strict=True))]
            for line in lines
        )
        return "\n".join([self.title, "", *(f"| {' | '.join(line)} |" for line in drawn), "", *self.notes, ""])

    def as_csv(self) -> str:
        """Return comma-separated values; a cell of several numbers takes as many columns."""
        file = io.StringIO()
        writer = csv.writer(file, lineterminator="\n")
        names, rows = self._flat()
        writer.writerows([names, *(["" if cell is None else cell_text(cell, 4) for cell in row] for row in rows)])
        return file.getvalue()

    def as_latex(self) -> str:
        """Return a tabular that needs no package, below title and notes as comments (`%`)."""
        comments = [f"% {printable(comment)}" for comment in (self.title, *self.notes)]
        cells = [map(_escaped, self.columns), *([_latex(cell, self.digits) for cell in row] for row in self.rows)]
        head, *body = (f"{' & '.join(line)} \\\\" for line in cells)
        begin = f"\\begin{{tabular}}{{l{'r' * (len(self.columns) - 1)}}}"
        lines = [*comments, begin, "\\hline", head, "\\hline", *body, "\\hline", "\\end{tabular}"]
        return "\n".join([*lines, ""])

    def as_dict(self) -> dict[str, Any]:
        """Return the table as JSON holds it: rows are objects with the columns of CSV."""
        names, rows = self._flat()
        plain = [[round(cell, 4) if isinstance(cell, float) else cell for cell in row] for row in rows]
        return {**self.about(), "rows": [dict(zip(names, row, strict=True)) for row in plain]}

    def about(self) -> dict[str, Any]:
        """Return the title and the notes."""
        return {"title": self.title, "notes": list(self.notes)}

    def _flat(self) -> tuple[list[str], list[list[Cell]]]:
        """Return headings and rows with one column for each number."""
        kinds = [next((_PARTS[type(row[i])] for row in self.rows if type(row[i]) in _PARTS), ())
                 for i in range(len(self.columns))]  # fmt: skip
        names = [f"{name} {part}".strip() for name, parts in zip(self.columns, kinds, strict=True)
                 for part in parts or ("",)]  # fmt: skip
        rows = [
            [value for cell, parts in zip(row, kinds, strict=True)
             for value in ([getattr(cell, part, None) for part in parts] if parts else [cell])]
            for row in self.rows
        ]  # fmt: skip
        return names, rows


FORMATS: Mapping[str, Callable[[ScoreTable], str]] = {
    "table": ScoreTable.as_markdown,
    "csv": ScoreTable.as_csv,
    "json": lambda table: json.dumps(table.as_dict(), indent=1, allow_nan=False) + "\n",
    "latex": ScoreTable.as_latex,
}
"""How a table is printed, by name."""
ENDINGS = {"table": ".md", "csv": ".csv", "json": ".json", "latex": ".tex"}
"""Ending of each format's file."""


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
        after.get(name) if before is None or name == "fidelity" else BeforeAfter(before.get(name), after.get(name))
        for name in metrics
    ]


def cell_text(cell: Cell, digits: int) -> str:
    """Return a cell as text, numbers with some decimals."""
    if isinstance(cell, BeforeAfter):
        return f"{cell_text(cell.before, digits)} -> {cell_text(cell.after, digits)}"
    if isinstance(cell, Interval):
        ends = "" if cell.low is None else f" [{cell_text(cell.low, digits)}, {cell_text(cell.high, digits)}]"
        return f"{cell_text(cell.mean, digits)}{ends}"
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


def _latex(cell: Cell, digits: int) -> str:
    match cell:
        case str():
            return _escaped(cell)
        case None:
            return "--"
        case BeforeAfter():
            return f"{_latex(cell.before, digits)} $\\to$ {_latex(cell.after, digits)}"
        case Interval(_, None, _):
            return _latex(cell.mean, digits)
        case Interval():
            return f"{_latex(cell.mean, digits)} $[{cell_text(cell.low, digits)}, {cell_text(cell.high, digits)}]$"
    return f"${cell_text(cell, digits)}$"


def _escaped(text: str) -> str:
    r"""Return text whose special characters are escaped for LaTeX.

    >>> _escaped("mIoU (%), a_b")
    'mIoU (\\%), a\\_b'
    """
    return "".join(_LATEX.get(character, character) for character in printable(text))
