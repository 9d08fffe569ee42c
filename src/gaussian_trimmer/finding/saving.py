"""What finding the objects of a scene leaves on disk: labels, a table, a picture of each, and a page to choose on."""

from __future__ import annotations

import colorsys
import csv
import io
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera, look_at, up_frame
from gaussian_trimmer.finding.found import FoundObject, FoundObjects
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.writing import npy_bytes, write_json, write_whole
from gaussian_trimmer.output.pages import asset, document, json_block, text
from gaussian_trimmer.output.pictures import Picture, as_picture, draw_number, write_picture
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.surface.overview import drawn_rows
from gaussian_trimmer.views.camera_rings import NEAR_RADII

FOUND_FILES = ("objects.npy", "objects.csv", "objects.json", "object_[0-9]*.png", "plan.png", "index.html", "batch.csv")
"""Patterns of the names of the files; the command adds the last one."""
_COLUMNS = (
    "id", "name", "sure", "confidence", "kind", "gaussians", "x", "y", "z", "length", "width", "height", "colour",
    "shown", "seen", "why",
)  # fmt: skip
_CELL_PIXELS = 240
"""Width and height of the picture of an object."""
_END_PERCENTILES = (1, 99)
"""Percentiles of an object's centres in a picture that are taken for its ends."""
_MARGIN = 0.25
"""Border around the object, relative to the longer side of its box."""
_DIMMED = 0.35
"""Brightness of what is not the object."""
_MOST_PICTURES = 100
_LONGER_PIXELS, _MANY_PIXELS, _MANY = 1400, 4000, 100
"""Longer side of the plan, and that of so many objects or more."""
_FONT_SCALE = 0.6
_DISTANCE = 4.0
"""Distance of the camera, relative to the longer side of the plan: far enough that little of any side shows."""
_PLAN_MARGIN = 0.05
"""Border around the outermost objects, relative to the longer side."""
_PLAN_DIMMED, _TINT = 0.7, 0.45
"""Brightness of what is not an object, and share of an object's colour on the plan that is not its own."""
_TURN = 0.618034
"""Of the colour circle, from one object to the next: colours of neighbours in the list are far apart."""


def write_found(
    found: FoundObjects,
    folder: Path,
    *,
    command: Sequence[str],
    names: Mapping[int, str],
) -> dict[str, Any]:
    """Write everything into an existing folder, and return what `objects.json` holds.

    Args:
        found: the objects.
        folder: where to write.
        command: the words of the command that the page completes.
        names: what users call objects, by their numbers.

    Raises:
        InputError: a file cannot be written.
    """
    write_whole(folder / "objects.npy", npy_bytes(found.labels.astype(np.int32)))
    rows = [described(one, names.get(one.id, "")) for one in found]
    write_whole(folder / "objects.csv", _table(rows))
    document_of = {
        "version": __version__,
        "up": {"direction": found.up.direction.tolist(), "source": found.up.source, "confidence": found.up.confidence},
        "objects": rows,
        "seconds": {name: round(time, 4) for name, time in found.seconds.items()},
    }
    write_json(document_of, folder / "objects.json")
    for one in found.objects[:_MOST_PICTURES]:
        write_picture(draw_found(found, one), folder / _picture_of(one))
    if found.objects:
        write_picture(draw_plan(found), folder / "plan.png")
    write_whole(folder / "index.html", page(found, command, names))
    return document_of


def described(one: FoundObject, name: str = "") -> dict[str, Any]:
    """Return one object as tables and JSON hold it; lengths in scene units."""
    red, green, blue = (round(255 * float(value)) for value in one.colour)
    place = dict(zip(("x", "y", "z"), one.centre.tolist(), strict=True))
    size = dict(zip(("length", "width", "height"), one.size.tolist(), strict=True))
    return {
        "id": one.id,
        "name": name,
        "sure": one.sure,
        "confidence": round(one.confidence, 3),
        "kind": one.kind,
        "gaussians": one.gaussians,
        **place,
        **size,
        "colour": f"#{red:02x}{green:02x}{blue:02x}",
        "shown": round(one.shown, 5),
        "seen": round(one.seen, 3),
        "why": one.why,
    }


def draw_found(found: FoundObjects, one: FoundObject) -> Picture:
    """Return an object in the view that shows it best, with what is around it dimmed."""
    view = found.views[one.view]
    rows = np.flatnonzero(found.looked_at)
    rows = rows[drawn_rows(found.scene.means[rows], view)]
    scene, mine = found.scene.select(rows), found.labels[rows] == one.id
    low, high = np.nanpercentile(view.camera.project(scene.means[mine])[0], _END_PERCENTILES, axis=0)
    half = max(1, round((0.5 + _MARGIN) * float((high - low).max())))
    x, y = ((low + high) / 2).round().astype(int).tolist()
    camera = view.camera.part(x - half, y - half, x + half, y + half).resized(_CELL_PIXELS / (2 * half))
    share = np.clip(blend_values(scene, camera, mine.astype(np.float32)[:, None]), 0, 1)
    return as_picture(render(scene, camera).rgb * (_DIMMED + (1 - _DIMMED) * share))


def draw_plan(found: FoundObjects) -> Picture:
    """Return the scene from above, without what was not looked at, with the objects and their numbers.

    The sure objects are in colour; if there are none, all are.
    """
    shown = [one for one in found if one.sure] or list(found)
    camera = _camera_above(found, np.array([one.centre for one in shown]), np.array([one.size for one in shown]))
    scene, labels = found.scene.select(found.looked_at), found.labels[found.looked_at]
    tints = np.zeros((len(found) + 1, 4), np.float32)
    for one in shown:
        tints[one.id] = *colorsys.hsv_to_rgb(_TURN * one.id % 1, 0.9, 1), 1
    blended = blend_values(scene, camera, tints[labels])
    share = np.clip(blended[..., 3:], 0, 1)
    rgb = render(scene, camera).rgb * (_PLAN_DIMMED + (1 - _PLAN_DIMMED - _TINT) * share) + _TINT * blended[..., :3]
    picture = np.ascontiguousarray(as_picture(rgb))
    for one, (x, y) in zip(shown, camera.project(np.array([one.centre for one in shown]))[0], strict=True):
        (width, height), _ = cv2.getTextSize(str(one.id), cv2.FONT_HERSHEY_SIMPLEX, _FONT_SCALE, 1)
        draw_number(picture, one.id, (round(x) - width // 2, round(y) + height // 2), _FONT_SCALE)
    return picture


def _camera_above(found: FoundObjects, centres: Float64Array, sizes: Float64Array) -> Camera:
    """Return a camera that looks down on boxes, by their middles and sizes along the axes of the frame, (O, 3) each."""
    axes = up_frame(found.up.direction)
    local = centres @ axes.T
    low, high = (local - sizes / 2).min(axis=0), (local + sizes / 2).max(axis=0)
    sides = (high - low)[:2] + 2 * _PLAN_MARGIN * float((high - low)[:2].max())
    longer, upwards = float(sides.max()), int(sides[1] <= sides[0])  # the picture is wide
    width = _LONGER_PIXELS if len(centres) < _MANY else _MANY_PIXELS
    height = max(1, round(width * float(sides.min()) / longer))
    middle = np.array([*(low + high)[:2] / 2, high[2]]) @ axes
    focal = _DISTANCE * width
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    pose = look_at(middle + _DISTANCE * longer * axes[2], middle, axes[upwards])
    return Camera(pose, K, width, height, near=NEAR_RADII * longer)


def page(found: FoundObjects, command: Sequence[str], names: Mapping[int, str]) -> str:
    """Return the page as HTML; it works without a server, and loads nothing but the pictures beside it."""
    cards = [_card(one, names.get(one.id, "")) for one in found]
    sure = sum(one.sure for one in found)
    plan = '<img src="plan.png" alt="the objects on a plan, by their numbers">'
    plan = f'<a href="plan.png">{plan}</a>' if found.objects else ""
    body = (
        f"<header><p><b>{sure} objects</b>, and {len(found) - sure} that the program is not sure of, at the end. "
        "Untick what you do not want, give the number of another object to merge with it, or tick split. The command "
        "then makes an object of each, and one scene without them.</p>"
        '<p><button id="all">tick all</button> <button id="none">untick all</button> '
        '<button id="copy">copy the command</button></p><textarea id="command" readonly></textarea>'
        f"{plan}</header>"
        f"<main>\n{chr(10).join(cards)}\n</main>{json_block('words', shlex.join(command))}"
    )
    style, script = asset("found_objects.css"), asset("found_objects.js")
    return document("Objects of the scene", body, style=style, script=script, stands_alone=False)


def _card(one: FoundObject, name: str) -> str:
    ticked = " checked" if one.sure else ""
    picture = f'<img src="{_picture_of(one)}" alt="object {one.id}">' if one.id <= _MOST_PICTURES else ""
    state = "sure" if one.sure else "unsure"
    return (
        f'<figure class="{state}" data-id="{one.id}">{picture}<figcaption>'
        f'<label><input type="checkbox" class="keep" data-sure="{int(one.sure)}"{ticked}> <b>{one.id}</b></label> '
        f'<input class="name" value="{text(name)}" placeholder="name" aria-label="name of object {one.id}"><br>'
        f'merge with <input class="merge" inputmode="numeric" size="3" aria-label="merge object {one.id} with"> '
        f'<label><input type="checkbox" class="split"> split</label><br>'
        f"{one.gaussians:,} Gaussians, {text(state)} ({one.confidence:.2f})<br>{text(one.why)}</figcaption></figure>"
    )


def _picture_of(one: FoundObject) -> str:
    return f"object_{one.id:03d}.png"


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    text_file = io.StringIO()
    writer = csv.DictWriter(text_file, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text_file.getvalue()
