"""`report.html`: a trim as one page to look at and to send to others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.html.comparison import comparison
from gaussian_trimmer.output.html.document import asset, document, text
from gaussian_trimmer.output.html.figures import (
    BACKGROUND_PAIRINGS,
    CHANGE_PAIRINGS,
    OBJECT_PAIRINGS,
    VIEW_PAIRINGS,
    Change,
    Figure,
    background_figures,
    legend_of,
    object_figures,
    view_figures,
)
from gaussian_trimmer.output.result import TrimResult

REPORT = "report.html"
"""Name of the page among the results."""
_MOST_OBJECTS = 24
_NO_TRUTH = (
    "A trim does not know where it is wrong. If you have masks of the object, <code>gaussian-trimmer evaluate SCENE "
    "RESULT --masks DIR --cameras PATH</code> measures the trim."
)
_NO_VIEW = "<p>No views: the inputs were found wrong before any was drawn.</p>"


def write_report_page(result: TrimResult, report: Mapping[str, Any], folder: Path) -> None:
    """Write the page of a trim whose report is given into an existing folder.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(folder / REPORT, report_page(result, report))


def report_page(result: TrimResult, report: Mapping[str, Any]) -> str:
    """Return the page of a trim as HTML: of several objects each before and after, in the scene and without them."""
    names = [Path(str(name)).name for name in map(report["inputs"].get, ("scene", "selection")) if name]
    scene = names[0] if names else "A scene"
    if len(result.objects) == 1:
        views = view_figures(result)
        title = f'{scene}, trimmed from "{names[1]}"' if len(names) == 2 else f"{scene}, trimmed"
        sections = {
            "views": ("Before and after", _views(result, views)),
            "changes": ("What was done", _changes(result, views)),
            "background": ("The scene without the object", _background(result)),
            "errors": ("Errors", f"<p>{_NO_TRUTH}</p>"),
            "numbers": ("Figures and settings", _numbers(report)),
        }
        return _page(title, _verdict(report, report["counts"]), sections)
    shown, sections = result.objects[:_MOST_OBJECTS], {}
    for part, entry in zip(shown, report["objects"], strict=False):
        name = f"object-{part.id}"
        figures = object_figures(result, part)
        drawn = comparison(f"pairing-{name}", figures, OBJECT_PAIRINGS) if figures else _NO_VIEW
        sections[name] = (text(part.title), _verdict(entry, entry["counts"]) + drawn)
    sections["changes"] = ("What was done", _changes(result, []))
    sections["numbers"] = ("Figures and settings", _numbers(report))
    few = f"<p>The first {len(shown)} of {len(result.objects)} objects are shown.</p>"
    title = f"{scene}: {len(result.objects)} objects, trimmed"
    return _page(title, few if len(shown) < len(result.objects) else "", sections)


def _page(title: str, introduction: str, sections: Mapping[str, tuple[str, str]]) -> str:
    """A page of sections: title and HTML by the name of each."""
    links = "".join(f'<a href="#{name}">{heading}</a>' for name, (heading, _) in sections.items())
    parts = "".join(
        f'<section id="{name}"><h2>{heading}</h2>{body}</section>' for name, (heading, body) in sections.items()
    )
    body = f"<header><h1>{text(title)}</h1>{introduction}<nav>{links}</nav></header><main>{parts}</main>"
    return document(title, body, style=asset("report.css"), script=asset("report.js"))


def _verdict(report: Mapping[str, Any], counts: Mapping[str, int]) -> str:
    """Whether it was trimmed, what came out, and what may be wrong."""
    if report["refused"]:
        state = (
            f'<p class="verdict bad" role="alert"><strong>Not trimmed:</strong> {text(report["refused"])}. The object '
            "is the selection as it came.</p>"
        )
    else:
        accepted = sum(view["accepted"] for view in report["views"])
        state = (
            f'<p class="verdict"><strong>{counts["object"]:,} Gaussians.</strong> {text(sentence_of(counts))}. '
            f"{accepted} of {len(report['views'])} views accepted; {text(report['checked']['sentence'])}.</p>"
        )
    doubts = "".join(f"<li>{text(sentence)}</li>" for sentence in report["warnings"])
    return f'{state}<ul class="doubts" role="alert">{doubts}</ul>' if doubts else state


def sentence_of(counts: Mapping[str, int]) -> str:
    """What became of the selected Gaussians.

    >>> sentence_of({"selected": 9, "kept": 5, "cut": 1, "removed": 2, "left_out": 1, "recovered": 3})
    'Of 9 selected, 5 kept, 1 cut, 2 removed, 1 left out; 3 more joined'
    """
    fates = ("kept", "cut", "removed", "left_out", "went_to_other_objects")
    words = ", ".join(f"{counts[fate]:,} {fate.replace('_', ' ')}" for fate in fates if fate in counts)
    return f"Of {counts['selected']:,} selected, {words}; {counts['recovered']:,} more joined"


def _views(result: TrimResult, figures: Sequence[Figure]) -> str:
    if not figures:
        return _NO_VIEW
    omitted = len(result.views) - len(figures)
    words = f"<p>{omitted} of {len(result.views)} views are not shown.</p>" if omitted else ""
    return words + comparison("views-pairing", figures, VIEW_PAIRINGS)


def _background(result: TrimResult) -> str:
    if not len(result.background_source):
        return "<p>Nothing is left: the file held the object alone, and nothing of it was removed.</p>"
    figures = background_figures(result)
    return comparison("background-pairing", figures, BACKGROUND_PAIRINGS) if figures else _NO_VIEW


def _changes(result: TrimResult, figures: Sequence[Figure]) -> str:
    """What the colours mean, how many rows of the files have them, and where they are."""
    lines = "".join(map(_legend_row, legend_of(result)))
    floaters = sum(part.floaters for part in result.objects)
    far = f" {floaters:,} of those that were removed lie far away, outside the pictures." if floaters else ""
    return (
        f"<p>The untouched rest of the scene is left out, since it would hide much.{far}</p>"
        f"<table><tbody>{lines}</tbody></table>"
        f"{comparison('changes-pairing', figures, CHANGE_PAIRINGS) if figures else ''}"
    )


def _legend_row(change: Change) -> str:
    return (
        f'<tr{"" if change.count else " class=none"}><td><span class="swatch" style="background: {change.colour}">'
        f'</span></td><th scope="row">{text(change.name.replace("_", " "))}</th>'
        f'<td class="number">{change.count:,}</td><td>{text(change.meaning)}</td></tr>'
    )


def _counts_and_times(report: Mapping[str, Any]) -> str:
    counts = [(name.replace("_", " "), f"{number:,}") for name, number in report["counts"].items()]
    times = [(name, f"{time:.2f} s") for name, time in report["seconds"].items()]
    return (
        f'<div class="columns"><div><h3>Gaussians</h3>{_table(counts, "number")}</div>'
        f"<div><h3>Time</h3>{_table(times, 'number')}</div></div>"
    )


def _numbers(report: Mapping[str, Any]) -> str:
    facts = [
        *((name, value) for name, value in _flat(report["inputs"]) if value not in (None, [], (), {})),
        *([("up vector", _up(report["up"]))] if "up" in report else []),
        *((name, report[name]) for name in ("segmenter", "renderer", "version")),
    ]
    defaults = dict(_flat(asdict(TrimConfig())))
    settings = [(name, value) for name, value in _flat(report["configuration"]) if value != defaults.get(name)]
    changed = _table(settings) if settings else "<p>None: all are the defaults.</p>"
    return f"{_counts_and_times(report)}<h3>Inputs</h3>{_table(facts)}<h3>Settings that were changed</h3>{changed}"


def _up(up: Mapping[str, Any]) -> str:
    direction = " ".join(f"{value:.3f}" for value in up["direction"])
    return f"{direction} ({up['source']}, confidence {up['confidence']:.2f})"


def _table(rows: Sequence[tuple[str, object]], kind: str = "") -> str:
    """A table of names and values as plain text; the class `number` puts values on the right."""
    lines = "".join(f'<tr><td>{text(name)}</td><td class="{kind}">{text(value)}</td></tr>' for name, value in rows)
    return f"<table><tbody>{lines}</tbody></table>"


def _flat(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as names with dots and values."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value
