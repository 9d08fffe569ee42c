"""What finding the objects of a scene leaves on disk: labels, a table, a picture of each, and a page to choose on."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.finding.found import FoundObject, FoundObjects
from gaussian_trimmer.finding.plan import draw_plan
from gaussian_trimmer.io.writing import write_json, write_whole
from gaussian_trimmer.output.html.document import asset, document, json_block, text
from gaussian_trimmer.output.pictures import Picture, as_picture, write_picture
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selecting.overview import drawn_rows
from gaussian_trimmer.selecting.saved_selection import save_array
from gaussian_trimmer.views import HALF, bounding_box, box_slices

FOUND_FILES = ("objects.npy", "objects.csv", "objects.json", "object_[0-9]*.png", "plan.png", "index.html", "batch.csv")
"""Patterns of the names of the files; the command adds the last one."""
_COLUMNS = (
    "id", "name", "sure", "confidence", "kind", "gaussians", "x", "y", "z", "length", "width", "height", "colour",
    "shown", "seen", "why",
)  # fmt: skip
_VIEW_PIXELS, _CELL_PIXELS = 960, 240
"""Longer side of the view that a picture is cut from, and width and height of the picture."""
_MARGIN = 0.25
"""Border around the object, relative to the larger side of its box."""
_DIMMED = 0.35
"""Brightness of what is not the object."""
_MOST_PICTURES = 100


def write_found(
    found: FoundObjects,
    folder: Path,
    renderer: Renderer,
    *,
    command: Sequence[str],
    names: Mapping[int, str],
) -> dict[str, Any]:
    """Write everything into an existing folder, and return what `objects.json` holds.

    Args:
        found: the objects.
        folder: where to write.
        renderer: draws the pictures.
        command: the words of the command that the page completes.
        names: what users call objects, by their numbers.

    Raises:
        InputError: a file cannot be written.
    """
    save_array(found.labels.astype(np.int32), folder / "objects.npy")
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
        write_picture(draw_found(found, one, renderer), folder / _picture_of(one))
    if found.objects:
        write_picture(draw_plan(found, renderer), folder / "plan.png")
    write_whole(folder / "index.html", page(found, command, names))
    return document_of


def described(one: FoundObject, name: str = "") -> dict[str, Any]:
    """One object as tables and JSON hold it; lengths in scene units."""
    red, green, blue = (round(255 * float(value)) for value in one.colour)
    place, size = (dict(zip(keys, values.tolist(), strict=True)) for keys, values in _boxes(one))
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


def draw_found(found: FoundObjects, one: FoundObject, renderer: Renderer) -> Picture:
    """An object in the view that shows it best, with what is around it dimmed."""
    view = found.views[one.view]
    rows = np.flatnonzero(found.looked_at)
    rows = rows[drawn_rows(found.scene.means[rows], view)]
    scene = found.scene.select(rows)
    camera = view.camera.resized(min(1.0, _VIEW_PIXELS / max(view.camera.width, view.camera.height)))
    mine = (found.labels[rows] == one.id).astype(np.float32)
    share = renderer.blend_values(scene, camera, mine[:, None])
    rgb = renderer.render(scene, camera).rgb * (_DIMMED + (1 - _DIMMED) * np.clip(share, 0, 1))
    x0, y0, x1, y1 = bounding_box(share[..., 0] > HALF)
    box = bounding_box(share[..., 0] > HALF, 2 + int(_MARGIN * max(x1 - x0, y1 - y0)))
    cut = as_picture(np.ascontiguousarray(rgb[box_slices(box)]))
    scale = _CELL_PIXELS / max(cut.shape[:2])
    size = max(1, round(cut.shape[1] * scale)), max(1, round(cut.shape[0] * scale))
    cut = np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR), np.uint8)
    cell = np.zeros((_CELL_PIXELS, _CELL_PIXELS, 3), np.uint8)
    top, left = (_CELL_PIXELS - cut.shape[0]) // 2, (_CELL_PIXELS - cut.shape[1]) // 2
    cell[top : top + cut.shape[0], left : left + cut.shape[1]] = cut
    return cell


def page(found: FoundObjects, command: Sequence[str], names: Mapping[int, str]) -> str:
    """The page as HTML; it works without a server, and loads nothing but the pictures beside it."""
    cards = [_card(one, names.get(one.id, "")) for one in found]
    sure = sum(one.sure for one in found)
    plan = '<img src="plan.png" alt="the objects on a plan, by their numbers">' if found.objects else ""
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


def _boxes(one: FoundObject) -> list[tuple[tuple[str, str, str], Any]]:
    return [(("x", "y", "z"), one.centre), (("length", "width", "height"), one.size)]


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    text_file = io.StringIO()
    writer = csv.DictWriter(text_file, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text_file.getvalue()
