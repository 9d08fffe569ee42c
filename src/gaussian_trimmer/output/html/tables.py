"""Tables of a page: figures, times and settings as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gaussian_trimmer.output.html.document import text

_WIDEST = 100


def table(header: Sequence[str], rows: Sequence[Sequence[object]], *, marked: Sequence[bool] = ()) -> str:
    """A table of plain text whose numbers stand on the right.

    Args:
        header: heads of the columns; none if it is empty.
        rows: the cells.
        marked: which rows are emphasised; none if it is empty.
    """
    heads = "".join(f'<th scope="col">{text(name)}</th>' for name in header)
    lines = "".join(
        f"<tr{' class=marked' if marked and marked[i] else ''}>{''.join(map(_cell, row))}</tr>"
        for i, row in enumerate(rows)
    )
    return f"<table>{f'<thead><tr>{heads}</tr></thead>' if header else ''}<tbody>{lines}</tbody></table>"


def bars(values: Mapping[str, float], unit: str) -> str:
    """A table of amounts with a bar each, in the order given."""
    most = max(values.values(), default=0.0) or 1.0
    lines = "".join(
        f'<tr><th scope="row">{text(name)}</th><td class="number">{value:.2f} {text(unit)}</td>'
        f'<td class="bar"><span style="width: {_WIDEST * value / most:.1f}%"></span></td></tr>'
        for name, value in values.items()
    )
    return f"<table><tbody>{lines}</tbody></table>"


def flat(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as names with dots and values.

    >>> list(flat({"plan": {"views": 5}, "up": None}))
    [('plan.views', 5), ('up', None)]
    """
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _cell(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"<td>{text(value)}</td>"
    return f'<td class="number">{f"{value:,}" if isinstance(value, int) else f"{value:.3f}"}</td>'
