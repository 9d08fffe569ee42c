"""`report.html`: a trim as one page, to be looked at, moved through and sent to others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.output.checked_sides import CheckedSides, checked_sides
from gaussian_trimmer.output.html.changes import Change, coloured_changes, legend_of
from gaussian_trimmer.output.html.comparison import Figure, comparison
from gaussian_trimmer.output.html.document import asset, document, text
from gaussian_trimmer.output.html.layers import (
    BACKGROUND_PAIRINGS,
    CHANGE_PAIRINGS,
    VIEW_PAIRINGS,
    background_figures,
    view_figures,
)
from gaussian_trimmer.output.html.tables import bars, flat, table
from gaussian_trimmer.output.html.turntable import addresses, dial, ring_of_trim, turntable
from gaussian_trimmer.result import TrimResult

REPORT = "report.html"
"""Name of the page among the results."""
_LIMIT = 7_500_000
"""Characters that all pictures together may have, so that the page stays below 8 MB."""
_SECTIONS = (
    ("views", "Before and after"), ("turn", "All around"), ("changes", "What was done"),
    ("background", "The scene without the object"), ("errors", "Errors"), ("numbers", "Figures and settings"),
)  # fmt: skip
_NO_TRUTH = (
    "Where the object is wrong cannot be said here: a trim does not know ground truth. Where there are masks of the "
    "object, <code>gaussian-trimmer evaluate SCENE RESULT --masks DIR --cameras PATH</code> measures the trim."
)


def write_report_page(result: TrimResult, report: Mapping[str, Any], folder: Path) -> None:
    """Write the page of a trim into an existing folder.

    Args:
        result: the trim.
        report: what `describe` returns.
        folder: where to write.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_file(folder / REPORT) as part:
        part.write_text(report_page(result, report), encoding="utf-8")


def report_page(result: TrimResult, report: Mapping[str, Any]) -> str:
    """The page as HTML. Arguments are those of `write_report_page`."""
    sides, changes = checked_sides(result), coloured_changes(result)
    views, behind = view_figures(result, changes), background_figures(result)
    ring = ring_of_trim(result, sides, changes)
    uris = addresses([*views, *behind], [ring], _LIMIT)
    parts = {
        "views": _views(result, views, uris),
        "turn": f'<div class="turning columns"><div>{turntable("turn", ring, uris)}</div><div>{_sides(result, sides)}'
        "</div></div>",
        "changes": _changes(result, report, views, uris),
        "background": _background(result, behind, uris),
        "errors": f"<p>{_NO_TRUTH}</p>",
        "numbers": _numbers(report),
    }
    links = "".join(f'<a href="#{name}">{title}</a>' for name, title in _SECTIONS)
    sections = "".join(f'<section id="{name}"><h2>{title}</h2>{parts[name]}</section>' for name, title in _SECTIONS)
    title = _title(report)
    body = f"<header><h1>{text(title)}</h1>{_verdict(report)}<nav>{links}</nav></header><main>{sections}</main>"
    return document(title, body, style=asset("report.css"), script=asset("report.js"))


def _sides(result: TrimResult, sides: CheckedSides) -> str:
    """What was checked."""
    return (
        f"<p>The sides from above, with the places of the views: {text(sides.sentence())}. What no accepted view shows "
        f"was not judged.</p>{dial(result, sides)}"
    )


def _title(report: Mapping[str, Any]) -> str:
    """What was trimmed, by the names of the files if they are known."""
    given = [report["inputs"].get(name) for name in ("selection", "scene")]
    names = [Path(str(name)).name for name in given if name]
    return f"Trim of {' in '.join(names)}" if names else "A trim"


def _verdict(report: Mapping[str, Any]) -> str:
    """Whether it was trimmed, what came out, and what may be wrong."""
    counts = report["counts"]
    accepted = sum(view["accepted"] for view in report["views"])
    if report["refused"]:
        state = (
            f'<p class="verdict bad" role="alert"><strong>Not trimmed:</strong> {text(report["refused"])}. The object '
            "is the selection as it came.</p>"
        )
    else:
        state = (
            f'<p class="verdict"><strong>{counts["object"]:,} Gaussians</strong> of a selection of '
            f"{counts['selected']:,}: {counts['pruned']:,} pruned, {counts['recovered']:,} recovered, "
            f"{counts['dropped']:,} dropped that only the object hid. {accepted} of "
            f"{len(report['views'])} views accepted; {text(report['checked']['sentence'])}.</p>"
        )
    doubts = "".join(f"<li>{text(sentence)}</li>" for sentence in report["warnings"])
    return f'{state}<ul class="doubts" role="alert">{doubts}</ul>' if doubts else state


def _views(result: TrimResult, figures: Sequence[Figure], uris: Mapping[int, str]) -> str:
    if not figures:
        return "<p>No view was drawn: the inputs were found wrong before.</p>"
    omitted = len(result.views) - len(figures)
    words = f"<p>{omitted} of {len(result.views)} views are not shown.</p>" if omitted else ""
    return words + comparison("views-pairing", figures, VIEW_PAIRINGS, uris)


def _background(result: TrimResult, figures: Sequence[Figure], uris: Mapping[int, str]) -> str:
    if len(result.source_index) == len(result.object):
        return "<p>Nothing is left: the file held the object alone, and nothing of it was cut off.</p>"
    if not figures:
        return "<p>No picture was drawn: the inputs were found wrong before.</p>"
    return comparison("background-pairing", figures, BACKGROUND_PAIRINGS, uris)


def _changes(result: TrimResult, report: Mapping[str, Any], figures: Sequence[Figure], uris: Mapping[int, str]) -> str:
    """What the colours mean, how many Gaussians have them, and where they are."""
    lines = "".join(map(_legend_row, legend_of(result)))
    floaters = report["counts"]["floaters"]
    far = f" {floaters:,} of the pruned ones float far off, outside the pictures." if floaters else ""
    return (
        "<p>These colours are also those of the object turning. The rest of the scene is left out, since it would hide "
        f"much.{far}</p><table><tbody>{lines}</tbody></table>"
        f"{comparison('changes-pairing', figures, CHANGE_PAIRINGS, uris) if figures else ''}"
    )


def _legend_row(change: Change) -> str:
    return (
        f'<tr{"" if change.count else " class=none"}><td><span class="swatch" style="background: {change.colour}">'
        f'</span></td><th scope="row">{text(change.name.replace("_", " "))}</th>'
        f'<td class="number">{change.count:,}</td><td>{text(change.meaning)}</td></tr>'
    )


def _numbers(report: Mapping[str, Any]) -> str:
    defaults = dict(flat(asdict(TrimConfig())))
    settings = [(name, value, value != defaults.get(name)) for name, value in flat(report["configuration"])]
    changed = sum(differs for *_, differs in settings)
    up = report["up"]
    direction = " ".join(f"{value:.3f}" for value in up["direction"])
    facts = [
        *((name, value) for name, value in flat(report["inputs"]) if value not in (None, [], (), {})),
        ("up vector", f"{direction} ({up['source']}, confidence {up['confidence']:.2f})"),
        ("segmenter", report["segmenter"]), ("renderer", report["renderer"]), ("version", report["version"]),
    ]  # fmt: skip
    views = [
        (i, view["name"], "accepted" if view["accepted"] else f"rejected: {view['reason']}")
        for i, view in enumerate(report["views"])
    ]
    return (
        f'<div class="columns"><div><h3>Gaussians</h3>{table((), list(report["counts"].items()))}</div>'
        f"<div><h3>Time</h3>{bars(report['seconds'], 's')}</div></div>"
        f"<h3>Inputs</h3>{table((), facts)}"
        f"<h3>Views</h3>{table(('view', 'name', 'mask'), views)}"
        f"<details><summary>All settings, {changed} of them not the default</summary>"
        f"{table(('setting', 'value'), [row[:2] for row in settings], marked=[row[2] for row in settings])}</details>"
    )
