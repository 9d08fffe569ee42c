"""Tables of scores as Markdown, CSV, JSON and LaTeX; each carries notes on how its figures were measured."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gaussian_trimmer.errors import printable
from gaussian_trimmer.evaluation.scoring import METRICS, Scores


@dataclass(frozen=True)
class Change:
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

Cell = str | float | int | Change | Interval | None
_PARTS: Mapping[type, tuple[str, ...]] = {Change: ("before", "after"), Interval: ("mean", "low", "high")}
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
        """A Markdown table with aligned columns."""
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
        """Comma-separated values below title and notes as comments (`#`); a cell of several numbers takes as many."""
        parts = [next((_PARTS[type(row[i])] for row in self.rows if type(row[i]) in _PARTS), ())
                 for i in range(len(self.columns))]  # fmt: skip
        file = io.StringIO()
        file.writelines(f"# {comment}\n" for comment in (self.title, *self.notes))
        writer = csv.writer(file, lineterminator="\n")
        names = zip(self.columns, parts, strict=True)
        writer.writerow(f"{name} {part}".strip() for name, known in names for part in (known or ("",)))
        for row in self.rows:
            cells = zip(row, parts, strict=True)
            writer.writerow(
                value for cell, known in cells for value in (_split(cell, known) if known else [_plain(cell)])
            )
        return file.getvalue()

    def as_latex(self) -> str:
        """A tabular that needs no package, below title and notes as comments (`%`)."""
        comments = [f"% {printable(comment)}" for comment in (self.title, *self.notes)]
        cells = [map(_escaped, self.columns), *([_latex(cell, self.digits) for cell in row] for row in self.rows)]
        head, *body = (f"{' & '.join(line)} \\\\" for line in cells)
        begin = f"\\begin{{tabular}}{{l{'r' * (len(self.columns) - 1)}}}"
        lines = [*comments, begin, "\\hline", head, "\\hline", *body, "\\hline", "\\end{tabular}"]
        return "\n".join([*lines, ""])

    def as_dict(self) -> dict[str, Any]:
        """The table as JSON holds it: rows are objects by heading, and so are cells of several numbers."""
        rows = [{name: _json(cell) for name, cell in zip(self.columns, row, strict=True)} for row in self.rows]
        return {"title": self.title, "notes": list(self.notes), "rows": rows}


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
    """The metrics that some of the scores have, in the order of tables."""
    return [name for name in METRICS if any(name in score for score in scores)]


def heading(metric: str) -> str:
    """A metric with its unit.

    >>> heading("psnr")
    'extraction PSNR (dB)'
    """
    return f"{METRICS[metric]} {'(dB)' if metric in ('psnr', 'fidelity') else '(%)'}"


def score_cells(metrics: Sequence[str], before: Scores | None, after: Scores) -> list[Cell]:
    """A cell for each metric: a change, or a number if there is nothing before. Fidelity has no before."""
    return [
        after.get(name) if before is None or name == "fidelity" else Change(before.get(name), after.get(name))
        for name in metrics
    ]


def cell_text(cell: Cell, digits: int) -> str:
    """A cell as text, numbers with some decimals."""
    if isinstance(cell, Change):
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
        case Change():
            return f"{_latex(cell.before, digits)} $\\to$ {_latex(cell.after, digits)}"
        case Interval(_, None, _):
            return _latex(cell.mean, digits)
        case Interval():
            return f"{_latex(cell.mean, digits)} $[{cell_text(cell.low, digits)}, {cell_text(cell.high, digits)}]$"
    return f"${cell_text(cell, digits)}$"


def _escaped(text: str) -> str:
    r"""Text whose special characters are escaped for LaTeX.

    >>> _escaped("mIoU (%), a_b")
    'mIoU (\\%), a\\_b'
    """
    return "".join(_LATEX.get(character, character) for character in printable(text))


def _split(cell: Cell, parts: Sequence[str]) -> list[str]:
    return [_plain(getattr(cell, part, None)) for part in parts]


def _plain(cell: Cell) -> str:
    return "" if cell is None else cell_text(cell, 4)


def _json(cell: Cell) -> Any:
    if isinstance(cell, Change | Interval):
        return {part: _json(getattr(cell, part)) for part in _PARTS[type(cell)]}
    return round(cell, 4) if isinstance(cell, float) else cell
