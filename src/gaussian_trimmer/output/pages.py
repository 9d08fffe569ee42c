"""Pages that any browser opens without a server, and `report.html`, a trim as one page to look at and to send on.

Names of files and what they say come from strangers: what a template is given is escaped unless it is `Markup`. The
policy in a page's head lets no script run but the page's own, by its checksum, and a page that stands alone may not use
the network.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np
from markupsafe import Markup, escape

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import printable
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, concatenate
from gaussian_trimmer.output.pictures import (
    Picture,
    draw_gaussians,
    draw_outlines,
    nearby_background,
    nearby_rows,
    nearby_scene,
)
from gaussian_trimmer.output.report import changed_settings, flat, sentences
from gaussian_trimmer.trimming.result import RowLabel, TrimmedObject, TrimResult
from gaussian_trimmer.views.virtual_cameras import cameras_that_see

if TYPE_CHECKING:
    from jinja2 import Environment

_Thing = TypeVar("_Thing")
_MAX_TEXT = 4000
"""Characters of one text of a stranger's that a page shows."""
_MOST_PIXELS, _JPEG_QUALITY = 512, 85
"""Longer side of a picture."""
_MOST_OBJECTS, _MOST_VIEWS, _TRAINING_CAMERAS = 24, 12, 2
"""Number of objects, of views of all objects together, and of cameras from which the whole scene is shown."""
SELECTION, OBJECT, OUTLINES = "selection", "trimmed object", "outlines"
CHANGES, SCENE, REST = "what was done", "scene", "scene without the object"
_PAIRINGS = (
    ("before and after", SELECTION, OBJECT, "The selection and the trimmed object, each alone."),
    (
        "outline found in each view",
        OBJECT,
        OUTLINES,
        "The view as it was segmented: orange is the outline of the selection, light blue that of the mask, red that "
        "of a mask that was rejected.",
    ),
    ("scene and what is left", SCENE, REST, "The object should be gone, and everything else still there."),
    ("what was done", SELECTION, CHANGES, ""),
)
"""Pictures to compare: what this shows, the picture on the left, the one on the right, and what to look for."""
DISCARDED, FITTED = "discarded", "fitted"
_COLOURS_AND_MEANINGS = {
    "kept": ("#9a9a9a", "in the object as it was selected"),
    "removed": ("#d55e00", "was selected, and is now in the background"),
    "added": ("#00a070", "was not selected, and is now in the object"),
    "split_inside": ("#2a78d0", "a part of a Gaussian that was cut; it lies in the object"),
    "split_outside": ("#56b4e9", "a part of a Gaussian that was cut; it lies in the background"),
    "filled": ("#f0e442", "new: continues what the object stood on or leaned against"),
    "relit": ("#b8860b", "in the background, brightened to remove the object's shadow"),
    DISCARDED: ("#c45fb0", "in neither file: only the object hid it, or a new one took its place; selected or not"),
    FITTED: ("#e69f00", "adjusted to the outline (also counted above); shown in this colour if kept"),
}
_BLACK_BRIGHTNESS = 0.4
"""How bright a black Gaussian is drawn, relative to a white one of its colour."""
_LUMINANCE_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)


def document(title: str, body: str, *, style: str = "", script: str = "", stands_alone: bool = True) -> str:
    """Return a whole page.

    Args:
        title: plain text.
        body: HTML.
        style: CSS beside that of all pages.
        script: JavaScript that runs when the body is there.
        stands_alone: nothing outside the page is needed, so that nothing outside may be loaded; otherwise pictures
            beside the page are shown.
    """
    checksum = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    scripts = f"'sha256-{checksum}'" if script else "'none'"
    policy = [f"script-src {scripts}", "base-uri 'none'", "form-action 'none'"]
    if stands_alone:
        policy = ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", *policy]
    page = {"style": Markup(asset("page.css") + style), "body": Markup(body), "script": Markup(script)}
    return _render("page.html", title=title, policy="; ".join(policy), **page)


def _render(template: str, **values: Any) -> str:
    """Return a template of `assets` with values, all of which are shown as plain text unless they are `Markup`."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(
        loader=FunctionLoader(asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: value if isinstance(value, Markup) else printable(str(value), _MAX_TEXT),
    )


@cache
def asset(name: str) -> str:
    """Return the text of a file of this folder's `assets`."""
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def text(value: object) -> str:
    """Return anything as HTML that shows it as plain text, also within quotes of an attribute.

    >>> text("<b>'a' & b</b>")
    '&lt;b&gt;&#39;a&#39; &amp; b&lt;/b&gt;'
    """
    return str(escape(printable(str(value), _MAX_TEXT)))


def json_block(name: str, value: Any) -> str:
    """Return an element that holds data for the page's script, which finds it by its name.

    >>> json_block("a", "</script>")
    '<script type="application/json" id="a">"\\\\u003c/script>"</script>'
    """
    data = json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{data}</script>'


def report_page(result: TrimResult, report: Mapping[str, Any]) -> str:
    """Return the page of a trim as HTML, with a section for each object.

    Args:
        result: the trim.
        report: what `describe` returns.
    """
    shown, said = result.objects[:_MOST_OBJECTS], sentences(report)
    sections = [
        {
            "name": f"object-{part.id}",
            "heading": part.title,
            "entry": entry,
            "verdict": verdict,
            "figures": _draw_views(result, part, _MOST_VIEWS // len(shown)),
            "all_views": len(part.views),
        }
        for part, entry, verdict in zip(shown, report["objects"], said, strict=False)
    ]
    seeing = _evenly(cameras_that_see(result.cameras, result.objects[0].bounds), _TRAINING_CAMERAS)
    seeing = [] if result.nothing_trimmed else seeing
    layers = {SCENE: result.scene, REST: result.background} if seeing else {}
    scene, selection = (Path(str(report["inputs"].get(name) or "")).name for name in ("scene", "selection"))
    what = f": {len(result.objects)} objects, trimmed" if len(result.objects) > 1 else ", trimmed"
    what += f' from "{selection}"' if selection and len(result.objects) == 1 else ""
    body = _render(
        "report.html",
        title=(scene or "A scene") + what,
        report=report,
        sections=sections,
        scene=said[-1],
        omitted=len(result.objects) - len(shown),
        whole=[
            _draw_figure(f"the whole scene from {camera.name or 'a training camera'}", camera, layers)
            for camera in seeing
        ],
        pairings=_PAIRINGS,
        legend=legend_of(result, report),
        floaters=sum(part.floaters for part in result.objects),
        counts=[(name.replace("_", " "), f"{number:,}") for name, number in report["counts"].items()],
        times=[(name, f"{time:.2f} s") for name, time in report.get("seconds", {}).items()],
        facts=[pair for pair in flat(report["inputs"]).items() if pair[1] not in (None, [], (), {})],
        settings=list(changed_settings(report["configuration"]).items()),
        data_uri=_data_uri,
    )
    return document((scene or "A scene") + what, body, style=asset("report.css"), script=asset("report.js"))


def _draw_views(result: TrimResult, part: TrimmedObject, most: int) -> list[dict[str, Any]]:
    """Draw views of an object, about as many as `most`, of which rejected ones come before others.

    Each shows selection, object, what was done, the scene with and without it, and the outlines if these were kept.
    """
    numbers, most = range(len(part.views)), max(1, most)
    rejected = [i for i in numbers if part.views[i].rejected]
    accepted = [i for i in numbers if not part.views[i].rejected]
    few = _evenly(rejected, most // 2 if accepted else most)
    layers = {
        SELECTION: result.scene.select(part.selected_rows),
        OBJECT: part.gaussians,
        CHANGES: coloured_changes(result, part),
        SCENE: nearby_scene(result, part),
    } | ({} if result.nothing_trimmed else {REST: nearby_background(result, part)})
    figures = []
    for number in sorted([*few, *_evenly(accepted, most - len(few))]):
        view, camera = part.views[number], part.views[number].view.camera
        name = f" ({camera.name})" if camera.name else ""
        figure = _draw_figure(f"view {number}{name}", camera, layers)
        if view.view.rgb.size:
            size = figure["pictures"][OBJECT].shape[1::-1]
            figure["pictures"][OUTLINES] = cv2.resize(draw_outlines(view), size, interpolation=cv2.INTER_AREA)
        figures.append(figure | {"doubt": f"rejected: {view.rejected}" if view.rejected else ""})
    return figures


def _draw_figure(caption: str, camera: Camera, layers: Mapping[str, Gaussians]) -> dict[str, Any]:
    """Draw one point of view: a picture of each of several sets of Gaussians, by what they are."""
    camera = camera.resized(min(1.0, _MOST_PIXELS / max(camera.width, camera.height)))
    pictures = {name: draw_gaussians(layer, camera) for name, layer in layers.items()}
    return {"caption": caption, "pictures": pictures, "doubt": ""}


def _evenly(things: Sequence[_Thing], count: int) -> list[_Thing]:
    """Return that many of the things, evenly spread; all of them if they are no more."""
    if len(things) <= count:
        return list(things)
    return [things[i * len(things) // count] for i in range(count)]


def legend_of(result: TrimResult, report: Mapping[str, Any]) -> list[tuple[str, str, str, int]]:
    """Return what can happen to a Gaussian: name, colour in CSS, meaning, and to how many Gaussians or rows it did."""
    counts = {label.name.lower(): result.count(label) for label in RowLabel}
    for name in ("kept", "removed", "added"):
        counts[name] = sum(entry["counts"][name] for entry in report["objects"])
    counts |= {DISCARDED: len(result.discarded), FITTED: sum(len(part.fitted) for part in result.objects)}
    return [(name, *_COLOURS_AND_MEANINGS[name], number) for name, number in counts.items()]


def coloured_changes(result: TrimResult, part: TrimmedObject) -> Gaussians:
    """Return an object in grey with all that changed around it in the colours of the legend.

    The untouched background is left out: it would hide much of what happened.
    """
    scene, rows, appended = result.scene, result.rest.rows, result.rest.appended
    palette = np.array([_rgb(label.name.lower()) for label in RowLabel], np.float32)
    painted = palette[part.label]
    painted[part.fitted[part.label[part.fitted] == RowLabel.KEPT]] = _rgb(FITTED)
    removed = nearby_rows(scene, rows[result.background_label[: len(rows)] != RowLabel.KEPT], part.bounds)
    new = nearby_rows(appended, np.arange(len(appended)), part.bounds)
    discarded = nearby_rows(scene, result.discarded, part.bounds)
    return concatenate(
        [
            _painted(part.gaussians, painted),
            _painted(scene.select(removed), np.tile(palette[RowLabel.REMOVED], (len(removed), 1))),
            _painted(appended.select(new), palette[result.background_label[len(rows) + new]]),
            _painted(scene.select(discarded), np.tile(_rgb(DISCARDED), (len(discarded), 1))),
        ]
    )


def _painted(gaussians: Gaussians, colours: FloatArray) -> Gaussians:
    """Return Gaussians in other colours (N, 3), the same from any side, as bright as they were but none black."""
    light = np.clip((0.5 + SH_C0 * gaussians.sh_dc) @ _LUMINANCE_WEIGHTS, 0, 1)
    rgb = colours * (_BLACK_BRIGHTNESS + (1 - _BLACK_BRIGHTNESS) * light)[:, None]
    sh_dc, no_rest = ((rgb - 0.5) / SH_C0).astype(np.float32), np.zeros((len(gaussians), 3, 0), np.float32)
    return gaussians.replace(sh_dc=sh_dc, sh_rest=no_rest, extras={})


def _rgb(name: str) -> FloatArray:
    """Return red, green and blue from 0 to 1 of what happened to a Gaussian, (3,)."""
    colour = _COLOURS_AND_MEANINGS[name][0]
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.float32) / np.float32(255)


def _data_uri(picture: Picture) -> Markup:
    """Return an address that holds the picture itself."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    assert done, "OpenCV writes JPEG"
    return Markup(f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}")
