"""`report.html`: a trim as one page to look at and to send to others."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
from markupsafe import Markup

from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.html.document import as_markup, asset, document, render_page
from gaussian_trimmer.output.html.figures import (
    BACKGROUND_PAIRINGS,
    CHANGE_PAIRINGS,
    OBJECT_PAIRINGS,
    VIEW_PAIRINGS,
    Pairing,
    background_figures,
    legend_of,
    object_figures,
    view_figures,
)
from gaussian_trimmer.output.pictures import Picture
from gaussian_trimmer.output.report import alerts
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.up_vector import up_text

REPORT = "report.html"
"""Name of the page among the results."""
_MOST_OBJECTS = 24
_JPEG_QUALITY = 85


def write_report_page(result: TrimResult, report: Mapping[str, Any], folder: Path) -> None:
    """Write the page of a trim whose report is given into an existing folder.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(folder / REPORT, report_page(result, report))


def report_page(result: TrimResult, report: Mapping[str, Any]) -> str:
    """Return the page of a trim as HTML.

    Args:
        result: the trim.
        report: what `describe` returns.
    """
    several = len(result.objects) > 1
    parts = _objects(result, report) if several else _one_object(result)
    links = [(section["name"], section["heading"]) for section in parts.get("sections", ())]
    links += [] if several else [("views", "Before and after")]
    links += [("changes", "What was done")]
    links += [] if several else [("background", "The scene without the object"), ("errors", "How good is it?")]
    title = _title(result, report["inputs"])
    body = render_page(
        "report.html",
        title=title,
        report=report,
        several=several,
        links=[*links, ("numbers", "Figures and settings")],
        legend=legend_of(result, report),
        floaters=sum(part.floaters for part in result.objects),
        counts=[(name.replace("_", " "), f"{number:,}") for name, number in report["counts"].items()],
        times=[(name, f"{time:.2f} s") for name, time in report.get("seconds", {}).items()],
        facts=list(_facts(report)),
        settings=list(_changed_settings(report["configuration"])),
        sentence_of=sentence_of,
        alerts=alerts,
        layers_of=_layers_of,
        data_uri=_data_uri,
        **parts,
    )
    return document(title, body, style=asset("report.css"), script=asset("report.js"))


def _one_object(result: TrimResult) -> dict[str, Any]:
    """What the template shows of the only object."""
    views = view_figures(result)
    return {
        "views": views,
        "omitted_views": len(result.views) - len(views),
        "background": background_figures(result) if len(result.background_source) else [],
        "pairings": {"views": VIEW_PAIRINGS, "changes": CHANGE_PAIRINGS, "background": BACKGROUND_PAIRINGS},
    }


def _objects(result: TrimResult, report: Mapping[str, Any]) -> dict[str, Any]:
    """What the template shows of several objects."""
    shown = result.objects[:_MOST_OBJECTS]
    sections = [
        {"name": f"object-{part.id}", "heading": part.title, "entry": entry, "figures": object_figures(result, part)}
        for part, entry in zip(shown, report["objects"], strict=False)
    ]
    omitted = len(result.objects) - len(shown)
    return {"sections": sections, "omitted_objects": omitted, "views": [], "pairings": {"object": OBJECT_PAIRINGS}}


def _title(result: TrimResult, inputs: Mapping[str, Any]) -> str:
    names = [Path(str(name)).name for name in map(inputs.get, ("scene", "selection")) if name]
    scene = names[0] if names else "A scene"
    if len(result.objects) > 1:
        return f"{scene}: {len(result.objects)} objects, trimmed"
    return f'{scene}, trimmed from "{names[1]}"' if len(names) == 2 else f"{scene}, trimmed"


def sentence_of(counts: Mapping[str, int]) -> str:
    """Say what became of the selected Gaussians.

    >>> sentence_of({"selected": 9, "kept": 5, "cut": 1, "removed": 2, "discarded": 1, "added": 3})
    'Of 9 selected, 5 kept, 1 cut, 2 removed, 1 discarded; 3 added'
    """
    fates = ("kept", "cut", "removed", "discarded", "went_to_other_objects")
    words = ", ".join(f"{counts[fate]:,} {fate.replace('_', ' ')}" for fate in fates if fate in counts)
    return f"Of {counts['selected']:,} selected, {words}; {counts['added']:,} added"


def _facts(report: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Names and values of what the trim was made of."""
    yield from ((name, value) for name, value in _flat(report["inputs"]) if value not in (None, [], (), {}))
    if "up" in report:
        yield "up vector", up_text(**report["up"])
    yield from ((name, report[name]) for name in ("segmenter", "version"))


def _changed_settings(configuration: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    defaults = dict(_flat(asdict(TrimConfig())))
    yield from ((name, value) for name, value in _flat(configuration) if value != defaults.get(name))


def _flat(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as names with dots and values."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _layers_of(pairings: Sequence[Pairing]) -> set[str]:
    return {layer for pairing in pairings for layer in (pairing.left, pairing.right)}


def _data_uri(picture: Picture) -> Markup:
    """An address that holds the picture itself."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    assert done, "OpenCV writes JPEG"
    return as_markup(f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}")
