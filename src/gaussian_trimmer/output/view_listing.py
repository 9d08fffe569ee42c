"""Views to click in: a picture of each, and a page that turns clicks into a command."""

from __future__ import annotations

import html
import json
import shlex
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.atomic import atomic_file
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Gaussians, IntArray
from gaussian_trimmer.output.pictures import Picture, write_picture
from gaussian_trimmer.rendering import Renderer

VIEW_FILES = ("[0-9][0-9][0-9].png", "index.html")
"""Patterns of the names of the files in a listing."""
_STEPS = (20, 25, 50, 100, 200, 250, 500, 1000)
_LINES = 12
"""Number of lines that a grid has along the longer side, about."""
_INK, _SHADE = (255, 255, 255), (0, 0, 0)
_FONT_SCALE = 0.4


def write_view_listing(
    scene: Gaussians, views: Sequence[tuple[Camera, IntArray]], whole: Sequence[int], command: Sequence[str],
    folder: Path, renderer: Renderer, *, grid: bool = False,
) -> None:  # fmt: skip
    """Write a picture of each view, 000.png and so on, and `index.html`.

    Args:
        views: the cameras, and the rows of the Gaussians that are drawn in each.
        whole: numbers of the views that show the whole capture, which the page shows first.
        command: the words of the command that the page completes by the marks.
        folder: an existing folder.
        grid: draw a grid of pixel numbers over the pictures.

    Raises:
        InputError: a file cannot be written.
    """
    for number, (camera, rows) in enumerate(views):
        drawn = scene if len(rows) == len(scene) else scene.select(rows)
        bgr = np.clip(renderer.render(drawn, camera).rgb[..., ::-1], 0, 1)
        picture = np.ascontiguousarray((255 * bgr).astype(np.uint8))
        write_picture(with_grid(picture) if grid else picture, folder / f"{number:03d}.png")
    with atomic_file(folder / "index.html") as part:
        part.write_text(page([camera for camera, _ in views], whole, command), encoding="utf-8")


def with_grid(picture: Picture) -> Picture:
    """A picture with lines at round pixel numbers, which stand at its upper and left edge."""
    height, width = picture.shape[:2]
    step = next((step for step in _STEPS if step * _LINES >= max(height, width)), _STEPS[-1])
    drawn = picture.copy()
    for x in range(step, width, step):
        cv2.line(drawn, (x, 0), (x, height - 1), _INK, 1)
    for y in range(step, height, step):
        cv2.line(drawn, (0, y), (width - 1, y), _INK, 1)
    drawn = np.asarray(cv2.addWeighted(drawn, 0.25, picture, 0.75, 0), np.uint8)
    for x in range(step, width, step):
        _number(drawn, x, (x + 2, 10))
    for y in range(step, height, step):
        _number(drawn, y, (2, y - 3))
    return drawn


def page(cameras: Sequence[Camera], whole: Sequence[int], command: Sequence[str]) -> str:
    """The page as HTML; it works without a server, and loads nothing but the pictures beside it."""
    order = [*whole, *(number for number in range(len(cameras)) if number not in set(whole))]
    figures = []
    for number in order:
        camera = cameras[number]
        name = f" {html.escape(camera.name)}" if camera.name else ""
        kind = ", the whole capture" if number in set(whole) and len(whole) < len(cameras) else ""
        figures.append(
            f'<figure><div class="view" data-view="{number}" data-width="{camera.width}" data-height="{camera.height}">'
            f'<img src="{number:03d}.png" width="{camera.width}" height="{camera.height}" alt="view {number}" '
            f'draggable="false"><svg viewBox="0 0 {camera.width} {camera.height}"></svg></div>'
            f"<figcaption>view {number}{name}{kind}<span></span></figcaption></figure>"
        )
    words = json.dumps(shlex.join(command)).replace("<", "\\u003c")
    return _PAGE.replace("@FIGURES@", "\n".join(figures)).replace("@COMMAND@", words)


def _number(picture: Picture, number: int, place: tuple[int, int]) -> None:
    for colour, thickness in ((_SHADE, 3), (_INK, 1)):
        cv2.putText(
            picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, _FONT_SCALE, colour, thickness, cv2.LINE_AA
        )  # fmt: skip


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Views to click in</title>
<style>
body { font: 15px/1.4 sans-serif; margin: 0; background: #f4f4f2; color: #222; }
header { position: sticky; top: 0; z-index: 1; background: #fff; padding: 10px 16px; border-bottom: 1px solid #ccc; }
header p { margin: 0 0 6px; }
textarea { width: 100%; box-sizing: border-box; height: 3.6em; font: 13px monospace; }
main { display: flex; flex-wrap: wrap; gap: 14px; padding: 16px; }
figure { margin: 0; }
.view { position: relative; width: min(640px, 94vw); cursor: crosshair; line-height: 0; touch-action: none; }
.view img { width: 100%; height: auto; background: #000; user-select: none; }
.view svg { position: absolute; inset: 0; width: 100%; height: 100%; }
figcaption span { float: right; font-family: monospace; }
</style></head><body>
<header>
<p><b>Click</b> on what you want, <b>drag</b> a box around it; with <b>Shift</b>, or with "remove" ticked, on what
you do not want. Later clicks belong in the middle of what is missing or too much.</p>
<p><label><input type="checkbox" id="remove"> remove</label> <button id="undo">undo</button>
<button id="clear">clear</button> <button id="copy">copy the command</button></p>
<textarea id="command" readonly></textarea>
</header>
<main>
@FIGURES@
</main>
<script>
"use strict";
const command = @COMMAND@;
const marks = [];
const text = document.getElementById("command");
const views = [...document.querySelectorAll(".view")];

function draw() {
  let line = command, current = null;
  for (const view of views) view.querySelector("svg").replaceChildren();
  for (const mark of marks) {
    if (mark.view !== current) { line += " --view-index " + mark.view; current = mark.view; }
    line += (mark.remove ? " --remove-" : " --") + (mark.p.length === 2 ? "click " : "box ") + mark.p.join(" ");
    show(mark);
  }
  text.value = marks.length ? line : command + "  (click in a view)";
}

function show(mark) {
  const view = views.find(v => +v.dataset.view === mark.view);
  const box = mark.p.length === 4;
  const shape = document.createElementNS("http://www.w3.org/2000/svg", box ? "rect" : "circle");
  const set = box
    ? { x: mark.p[0], y: mark.p[1], width: mark.p[2] - mark.p[0], height: mark.p[3] - mark.p[1], fill: "none" }
    : { cx: mark.p[0] + 0.5, cy: mark.p[1] + 0.5, r: +view.dataset.width / 100 };
  set.stroke = mark.remove ? "#ff4030" : "#30e060";
  set["stroke-width"] = +view.dataset.width / 250;
  if (!box) set.fill = mark.remove ? "#ff403080" : "#30e06080";
  for (const name in set) shape.setAttribute(name, set[name]);
  view.querySelector("svg").append(shape);
}

function pixel(view, event) {
  const frame = view.getBoundingClientRect(), w = +view.dataset.width, h = +view.dataset.height;
  const x = Math.floor((event.clientX - frame.left) / frame.width * w);
  const y = Math.floor((event.clientY - frame.top) / frame.height * h);
  return [Math.min(Math.max(x, 0), w - 1), Math.min(Math.max(y, 0), h - 1)];
}

for (const view of views) {
  let start = null;
  const place = view.parentElement.querySelector("span");
  view.addEventListener("pointerdown", event => {
    start = pixel(view, event);
    view.setPointerCapture(event.pointerId);
  });
  view.addEventListener("pointermove", event => { place.textContent = pixel(view, event).join(" "); });
  view.addEventListener("pointerup", event => {
    if (!start) return;
    const end = pixel(view, event), remove = event.shiftKey || document.getElementById("remove").checked;
    const far = Math.max(Math.abs(end[0] - start[0]), Math.abs(end[1] - start[1])) > +view.dataset.width / 100;
    const low = [Math.min(start[0], end[0]), Math.min(start[1], end[1])];
    const high = [Math.max(start[0], end[0]) + 1, Math.max(start[1], end[1]) + 1];
    marks.push({ view: +view.dataset.view, p: far ? [...low, ...high] : start, remove });
    start = null;
    draw();
  });
}
document.getElementById("undo").onclick = () => { marks.pop(); draw(); };
document.getElementById("clear").onclick = () => { marks.length = 0; draw(); };
document.getElementById("copy").onclick = () => {
  text.select();
  if (navigator.clipboard) navigator.clipboard.writeText(text.value); else document.execCommand("copy");
};
draw();
</script></body></html>
"""
