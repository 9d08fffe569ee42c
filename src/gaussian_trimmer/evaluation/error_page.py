"""A comparison with ground truth as one page: the table, and before, after and errors of each view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.scoring import Scores, Shown
from gaussian_trimmer.evaluation.sheets import TRUTH, cells_of_view
from gaussian_trimmer.evaluation.tables import ScoreTable, cell_text
from gaussian_trimmer.output.html.comparison import Figure, Pairing, comparison
from gaussian_trimmer.output.html.document import asset, document, text
from gaussian_trimmer.output.html.tables import table
from gaussian_trimmer.output.pictures import as_picture

MOST_VIEWS = 24
"""Views that the page shows, at most."""
_SIDE = 420
_COLOURS = "Red is too much, green is missing, dark pixels do not count; the rest is the photograph in grey, if known."


@dataclass
class WorstViews:
    """The views with the lowest IoU of all that are added, drawn when they are, so that few are in memory."""

    threshold: float
    """Opacity above which a pixel belongs to the object."""
    figures: list[tuple[float, str, Figure]] = field(default_factory=list)
    """IoU, name and pictures, the lowest IoU first."""

    def add(self, view: TestView, name: str, before: Shown | None, after: Shown, scores: Scores) -> None:
        """Draw a view if it is among the worst so far."""
        iou = scores.get("iou", 0.0)
        if len(self.figures) == MOST_VIEWS and iou >= self.figures[-1][0]:
            return
        cells = cells_of_view(view, before, after, self.threshold, _SIDE)
        figure = Figure(f"{name}: IoU {iou:.1f} %", {cell: as_picture(rgb) for cell, rgb in cells})
        self.figures = sorted([*self.figures, (iou, name, figure)], key=lambda entry: entry[:2])[:MOST_VIEWS]


def error_page(scores: ScoreTable, views: WorstViews) -> str:
    """The page as HTML.

    Args:
        scores: what was measured.
        views: what is shown, at least one view.
    """
    figures = [figure for *_, figure in views.figures]
    notes = "".join(f"<li>{text(note)}</li>" for note in scores.notes)
    rows = [[cell_text(cell, scores.digits) for cell in row] for row in scores.rows]
    few = f"; the {MOST_VIEWS} lowest are shown" if len(rows) - 1 > len(figures) else ""
    body = (
        f"<header><h1>{text(scores.title)}</h1></header><main><section><h2>Scores</h2>"
        f"{table(scores.columns, rows, marked=[False] * (len(rows) - 1) + [True])}<ul>{notes}</ul></section>"
        f"<section><h2>Views</h2><p>The lowest IoU first{few}.</p>"
        f"{comparison('pairing', figures, _pairings(list(figures[0].pictures)))}</section></main>"
    )
    return document(scores.title, body, style=asset("report.css"), script=asset("report.js"))


def _pairings(cells: Sequence[str]) -> list[Pairing]:
    """What can be compared, by what the figures have."""
    if "before" not in cells:
        return [
            Pairing("object and errors", "object", "errors object", _COLOURS),
            Pairing("object and truth", "object", TRUTH),
        ]
    return [
        Pairing("errors before and after", "errors before", "errors after", _COLOURS),
        Pairing("before and after", "before", "after"),
        Pairing("after and truth", "after", TRUTH),
        Pairing("after and its errors", "after", "errors after", _COLOURS),
    ]
