"""Tables of scores, as text (Markdown), CSV, JSON and LaTeX; every one carries its notes, such as the judge's rules."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gaussian_trimmer.evaluation.scoring import METRICS, Scores


@dataclass(frozen=True)
class Change:
    """A score before and after; None where it is not known."""

    before: float | None
    after: float | None

    @property
    def gain(self) -> float | None:
        """What was gained, None if one of the two is not known."""
        return None if self.before is None or self.after is None else self.after - self.before


Cell = str | float | int | Change | None


@dataclass(frozen=True)
class ScoreTable:
    """Rows of cells below headings, with a title and notes that belong to the figures."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()
    digits: int = 2
    """Decimals of numbers in text and LaTeX; CSV and JSON have four."""

    def as_text(self) -> str:
        """A Markdown table with aligned columns."""
        cells = [[cell_text(cell, self.digits) for cell in row] for row in self.rows]
        widths = [max(len(line[i]) for line in [list(self.columns), *cells]) for i in range(len(self.columns))]
        rule = [f"{'-' * (width - 1)}:" if i else "-" * width for i, width in enumerate(widths)]
        lines = [
            "| "
            + " | ".join(t.rjust(w) if i else t.ljust(w) for i, (t, w) in enumerate(zip(line, widths, strict=True)))
            + " |"
            for line in [list(self.columns), *cells]
        ]
        lines.insert(1, "|" + "|".join(f" {text} " for text in rule) + "|")
        return "\n".join([f"{self.title}", "", *lines, "", *self.notes]) + "\n"

    def as_csv(self) -> str:
        """Comma-separated values below comments (`#`) of title and notes; a change takes two columns."""
        changing = [any(isinstance(row[i], Change) for row in self.rows) for i in range(len(self.columns))]
        file = io.StringIO()
        for comment in (self.title, *self.notes):
            file.write(f"# {comment}\n")
        writer = csv.writer(file, lineterminator="\n")
        head: list[str] = []
        for name, change in zip(self.columns, changing, strict=True):
            head += [f"{name} before", f"{name} after"] if change else [name]
        writer.writerow(head)
        for row in self.rows:
            line: list[str] = []
            for cell, change in zip(row, changing, strict=True):
                pair = cell if isinstance(cell, Change) else Change(None, None)
                line += [_plain(pair.before), _plain(pair.after)] if change else [_plain(cell)]
            writer.writerow(line)
        return file.getvalue()

    def as_dict(self) -> dict[str, Any]:
        """The table as JSON holds it: rows are objects by heading, changes have `before` and `after`."""
        rows = [{name: _json(cell) for name, cell in zip(self.columns, row, strict=True)} for row in self.rows]
        return {"title": self.title, "notes": list(self.notes), "rows": rows}

    def as_latex(self) -> str:
        """A table environment for the booktabs package; the notes end the caption."""
        lines = [
            r"\begin{table}[htbp]", r"  \centering", rf"  \caption{{{_tex('. '.join([self.title, *self.notes]))}.}}",
            rf"  \begin{{tabular}}{{l{'c' * (len(self.columns) - 1)}}}", r"  \toprule",
            "  " + " & ".join(_tex(name) for name in self.columns) + r" \\", r"  \midrule",
        ]  # fmt: skip
        for row in self.rows:
            cells = (_tex(cell_text(cell, self.digits)).replace("->", r"$\to$") for cell in row)
            lines.append("  " + " & ".join(cells) + r" \\")
        return "\n".join([*lines, r"  \bottomrule", r"  \end{tabular}", r"\end{table}"]) + "\n"


FORMATS: Mapping[str, Callable[[ScoreTable], str]] = {
    "table": ScoreTable.as_text,
    "csv": ScoreTable.as_csv,
    "json": lambda table: json.dumps(table.as_dict(), indent=1, allow_nan=False) + "\n",
    "latex": ScoreTable.as_latex,
}
"""How a table is printed, by name."""
ENDINGS = {"table": ".md", "csv": ".csv", "json": ".json", "latex": ".tex"}
"""Ending of the file of each."""


def known_metrics(*scores: Scores) -> list[str]:
    """Metrics that some of the scores have, in the order of tables."""
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
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


def _plain(cell: Cell) -> str:
    if cell is None or isinstance(cell, Change):
        return ""
    return f"{cell:.4f}" if isinstance(cell, float) else str(cell)


def _json(cell: Cell) -> Any:
    if isinstance(cell, Change):
        return {"before": _json(cell.before), "after": _json(cell.after)}
    return round(cell, 4) if isinstance(cell, float) else cell


_SPECIAL = {character: f"\\{character}" for character in "&%$#_{}"}
_SPECIAL |= {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}


def _tex(text: str) -> str:
    r"""Text with what LaTeX would obey escaped.

    >>> print(_tex("100 % of a_b"))
    100 \% of a\_b
    """
    return "".join(_SPECIAL.get(character, character) for character in text)
