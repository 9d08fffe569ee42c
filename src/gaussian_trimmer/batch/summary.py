"""The summaries of a batch: `summary.csv` for programs, `summary.html` with pictures, the worst items first."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.store import Outcome, Store
from gaussian_trimmer.output.html.document import document, text
from gaussian_trimmer.output.html.report_page import sentence_of
from gaussian_trimmer.output.report import alerts

CSV, HTML = "summary.csv", "summary.html"
_COUNTS = ("selected", "object", "kept", "cut", "removed", "discarded", "added")
COLUMNS = (
    *("name", "state", "look_first", "message", "scene_gaussians", *_COUNTS),
    *("views_accepted", "views", "up_confidence", "seconds", "scene", "selection", "fingerprint"),
)
_MOST_PICTURES = 500
_CSS = (
    "body{margin:1em auto;max-width:60rem;padding:0 1em}article{border-top:1px solid var(--line);padding:.5em 0}"
    "h2{margin:.3em 0;overflow-wrap:anywhere}p{margin:.3em 0}img{max-width:100%;display:block}"
    ".failed{color:var(--bad)}.left{color:var(--faint)}"
)


def look_first(outcome: Outcome) -> float:
    """How much an outcome should be looked at, from 0 to 3, which is a failure.

    Of what was trimmed, the share of views that were rejected and that of the selection that changed count, of which a
    smaller side is a part; what else the trim warns of counts more, and most that it was left as it was selected.
    """
    if outcome.state != "done":
        return 3.0
    accepted, views = outcome.views
    rejected = 1 - accepted / views if views else 1.0
    changed = sum(outcome.counts.get(name, 0) for name in ("removed", "added"))
    share = min(1.0, changed / max(1, outcome.counts.get("selected", 0)))
    doubtful = 2.0 if outcome.refused else 1.0 if alerts(outcome.warnings, outcome.shrunk_side) else 0.0
    return doubtful + 0.5 * rejected + 0.5 * share


def write_summaries(store: Store, items: Sequence[Item], outcomes: Sequence[Outcome]) -> None:
    """Write both summaries; items without an outcome, as those of other shards, are looked up in the output.

    Several runs may write them at a time: each looks again at what it has written, so that the last one is complete.

    Raises:
        InputError: a summary cannot be written.
    """
    mine = {outcome.item.name: outcome for outcome in outcomes}
    others = [item for item in items if item.name not in mine]
    written: list[Outcome] | None = None
    while True:
        found = [_found(store, item) for item in others]
        if found == written:
            return
        rows = sorted([*mine.values(), *found], key=lambda outcome: (-look_first(outcome), outcome.item.name))
        store.write(CSV, as_csv(rows))
        store.write(HTML, as_html(rows))
        written = found
        if not others:
            return


def as_csv(outcomes: Sequence[Outcome]) -> str:
    """The table, a line for each outcome."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([_as_text(cell) for cell in row_of(outcome).values()] for outcome in outcomes)
    return text.getvalue()


def row_of(outcome: Outcome) -> dict[str, Any]:
    """Return a row of the table by its columns, as JSON holds it."""
    item = outcome.item
    told = [item.name, outcome.state, round(look_first(outcome), 4), outcome.told]
    counts = [outcome.counts.get(name, "") for name in ("scene", *_COUNTS)]
    up, seconds = round(outcome.up_confidence, 4), round(outcome.seconds, 3) if outcome.seconds else ""
    inputs = [str(item.scene), str(item.selection or ""), outcome.fingerprint]
    return dict(zip(COLUMNS, (*told, *counts, *outcome.views, up, seconds, *inputs), strict=True))


def _as_text(cell: object) -> object:
    """Return a cell that a spreadsheet does not take for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")) else cell


def as_html(outcomes: Sequence[Outcome]) -> str:
    """The page; the first outcomes have their pictures, which the browser fetches when they come into sight."""
    states = [outcome.state for outcome in outcomes]
    counts = ", ".join(f"{states.count(state)} {state}" for state in ("done", "failed", "left") if state in states)
    lines = [
        f"<h1>{len(outcomes)} items: {counts}</h1>\n<p>The worst first: what failed, what was left as "
        "it was selected, what the trim warns of, then by rejected views and by how much of the selection changed.</p>"
    ]
    shown = 0
    for outcome in outcomes:
        picture = ""
        if outcome.state == "done" and shown < _MOST_PICTURES:
            shown += 1
            link = f"items/{quote(outcome.item.name)}/before_after.png"
            picture = f'<a href="{link}"><img loading="lazy" src="{link}" alt=""></a>'
        lines.append(_row(outcome, picture))
    return document(f"{len(outcomes)} items: {counts}", "\n".join(lines), style=_CSS, stands_alone=False)


def _row(outcome: Outcome, picture: str) -> str:
    counts = outcome.counts
    known = {"selected": 0, "added": 0, "object": 0} | counts
    whole = f"{sentence_of(known)}. The object has {known['object']:,} Gaussians, with the parts of those cut."
    numbers = f"<p>{whole}</p>" if counts else ""
    views = f", views: {outcome.views[0]} of {outcome.views[1]}" if outcome.views[1] else ""
    return (
        f'<article class="{outcome.state}"><h2>{text(outcome.item.name)}</h2>{picture}<p>{outcome.state}, look first: '
        f"{look_first(outcome):.2f}{views}. {text(outcome.told)}</p>{numbers}</article>"
    )


def _found(store: Store, item: Item) -> Outcome:
    """What the output says of an item that another run had."""
    return store.earlier(item) or Outcome(item, "left", "no run has come to it yet", fresh=False)
