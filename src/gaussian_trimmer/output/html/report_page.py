"""`report.html`: a trim, or one of several objects, as one page to look at and to send to others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.html.changes import Change, coloured_changes, legend_of
from gaussian_trimmer.output.html.comparison import Figure, Pairing, comparison
from gaussian_trimmer.output.html.document import asset, document, text
from gaussian_trimmer.output.html.layers import (
    BACKGROUND_PAIRINGS,
    CHANGE_PAIRINGS,
    OBJECT,
    REST,
    SCENE,
    SELECTION,
    VIEW_PAIRINGS,
    background_figures,
    draw_figure,
    view_figures,
)
from gaussian_trimmer.output.pictures import nearby_rows
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.trimming.several_objects import ObjectsResult, TrimmedObject

REPORT = "report.html"
"""Name of the page among the results."""
_MOST_OBJECTS = 24
_NO_TRUTH = (
    "A trim does not know where it is wrong. If you have masks of the object, <code>gaussian-trimmer evaluate SCENE "
    "RESULT --masks DIR --cameras PATH</code> measures the trim."
)
_NO_VIEW = "<p>No views: the inputs were found wrong before any was drawn.</p>"
_OBJECT_PAIRINGS = (Pairing("before and after", SELECTION, OBJECT), *BACKGROUND_PAIRINGS)


def write_report_page(result: TrimResult | ObjectsResult, report: Mapping[str, Any], folder: Path) -> None:
    """Write the page of a trim, or of one of several objects, whose report is given, into an existing folder.

    Raises:
        InputError: the file cannot be written.
    """
    page = report_page(result, report) if isinstance(result, TrimResult) else objects_page(result, report)
    write_whole(folder / REPORT, page)


def report_page(result: TrimResult, report: Mapping[str, Any]) -> str:
    """The page of a trim as HTML."""
    views = view_figures(result, coloured_changes(result))
    names = [Path(str(name)).name for name in map(report["inputs"].get, ("scene", "selection")) if name]
    title = (
        f'{names[0]}, trimmed from "{names[1]}"' if len(names) == 2 else f"{names[0] if names else 'A scene'}, trimmed"
    )
    sections = {
        "views": ("Before and after", _views(result, views)),
        "changes": ("What was done", _changes(result, report, views)),
        "background": ("The scene without the object", _background(result)),
        "errors": ("Errors", f"<p>{_NO_TRUTH}</p>"),
        "numbers": ("Figures and settings", _numbers(report)),
    }
    return _page(title, _verdict(report, report["counts"]["object"]), sections)


def objects_page(result: ObjectsResult, report: Mapping[str, Any]) -> str:
    """The page of several objects as HTML: each before and after, in the scene and without it."""
    shown = result.objects[:_MOST_OBJECTS]
    scene = report["inputs"].get("scene")
    few = f"<p>The first {len(shown)} of {len(result.objects)} objects are shown.</p>"
    sections = {}
    for part, entry in zip(shown, report["objects"], strict=False):
        name = f"object-{part.id}"
        figures = [_object_figure(result, part)] if part.view is not None else []
        drawn = comparison(f"pairing-{name}", figures, _OBJECT_PAIRINGS) if figures else _NO_VIEW
        sections[name] = (text(part.title), _verdict(entry, entry["gaussians"]) + drawn)
    sections["numbers"] = ("Figures", _counts_and_times(report))
    title = f"{Path(str(scene)).name if scene else 'A scene'}: {len(result.objects)} objects, trimmed"
    return _page(title, few if len(shown) < len(result.objects) else "", sections)


def _page(title: str, introduction: str, sections: Mapping[str, tuple[str, str]]) -> str:
    """A page of sections: title and HTML by the name of each."""
    links = "".join(f'<a href="#{name}">{heading}</a>' for name, (heading, _) in sections.items())
    parts = "".join(
        f'<section id="{name}"><h2>{heading}</h2>{body}</section>' for name, (heading, body) in sections.items()
    )
    body = f"<header><h1>{text(title)}</h1>{introduction}<nav>{links}</nav></header><main>{parts}</main>"
    return document(title, body, style=asset("report.css"), script=asset("report.js"))


def _verdict(report: Mapping[str, Any], gaussians: int) -> str:
    """Whether it was trimmed, what came out, and what may be wrong."""
    if report["refused"]:
        state = (
            f'<p class="verdict bad" role="alert"><strong>Not trimmed:</strong> {text(report["refused"])}. The object '
            "is the selection as it came.</p>"
        )
    else:
        accepted = sum(view["accepted"] for view in report["views"])
        state = (
            f'<p class="verdict"><strong>{gaussians:,} Gaussians.</strong> {text(sentence_of(report["counts"]))}. '
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
    if len(result.source_index) == len(result.object):
        return "<p>Nothing is left: the file held the object alone, and nothing of it was removed.</p>"
    figures = background_figures(result)
    return comparison("background-pairing", figures, BACKGROUND_PAIRINGS) if figures else _NO_VIEW


def _changes(result: TrimResult, report: Mapping[str, Any], figures: Sequence[Figure]) -> str:
    """What the colours mean, how many rows of the files have them, and where they are."""
    lines = "".join(map(_legend_row, legend_of(result)))
    floaters = report["counts"]["floaters"]
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
    up = report["up"]
    direction = " ".join(f"{value:.3f}" for value in up["direction"])
    facts = [
        *((name, value) for name, value in _flat(report["inputs"]) if value not in (None, [], (), {})),
        ("up vector", f"{direction} ({up['source']}, confidence {up['confidence']:.2f})"),
        *((name, report[name]) for name in ("segmenter", "renderer", "version")),
    ]
    defaults = dict(_flat(asdict(TrimConfig())))
    settings = [(name, value) for name, value in _flat(report["configuration"]) if value != defaults.get(name)]
    changed = _table(settings) if settings else "<p>None: all are the defaults.</p>"
    return f"{_counts_and_times(report)}<h3>Inputs</h3>{_table(facts)}<h3>Settings that were changed</h3>{changed}"


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


def _object_figure(result: ObjectsResult, part: TrimmedObject) -> Figure:
    """One view of an object, before and after, in the scene and without all objects."""
    assert part.view is not None
    scene, outside = result.scene, result.outside_parts
    near = nearby_rows(scene, np.arange(len(scene)), part.bounds)
    parts = {
        SELECTION: scene.select(part.selection),
        OBJECT: part.gaussians,
        SCENE: scene.select(near),
        REST: concatenate(
            [
                scene.select(np.intersect1d(near, result.background_rows)),
                outside.select(nearby_rows(outside, np.arange(len(outside)), part.bounds)),
            ]
        ),
    }
    figure = draw_figure(f"object {part.id}", part.view.view.camera, parts, result.used_renderer)
    return Figure(figure.caption, figure.pictures, f"rejected: {part.view.rejected}" if part.view.rejected else "")
