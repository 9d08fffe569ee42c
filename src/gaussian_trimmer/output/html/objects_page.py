"""`report.html` of several objects that were trimmed together: each before, after and turning, and the scene behind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.gaussians import Gaussians, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.output.html.comparison import Figure, Pairing, comparison
from gaussian_trimmer.output.html.document import asset, document, text
from gaussian_trimmer.output.html.layers import OBJECT, REST, SCENE, SELECTION, small_camera
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.html.tables import bars, table
from gaussian_trimmer.output.html.turntable import Ring, addresses, draw_ring, turntable
from gaussian_trimmer.output.pictures import draw_gaussians
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
from gaussian_trimmer.trimming.several_objects import ObjectsResult, TrimmedObject

MOST_OBJECTS = 24
"""Objects that a page shows, at most."""
FRAMES = 12
"""Angles from which each object is drawn."""
_SIDE = 256
_CONTEXT = 1.8
"""Distance from an object up to which the scene is drawn behind it, in its radii."""
_LIMIT = 7_500_000
_PAIRINGS = (Pairing("before and after", SELECTION, OBJECT), Pairing("scene and what is left", SCENE, REST))
_COUNTS = ("selected", "kept", "pruned", "recovered", "split")


def write_objects_page(result: ObjectsResult, report: Mapping[str, Any], folder: Path) -> None:
    """Write the page of several trims into an existing folder.

    Args:
        result: the objects.
        report: what `describe_objects` returns.
        folder: where to write.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_file(folder / REPORT) as part:
        part.write_text(objects_page(result, report), encoding="utf-8")


def objects_page(result: ObjectsResult, report: Mapping[str, Any]) -> str:
    """The page as HTML. Arguments are those of `write_objects_page`."""
    shown = result.objects[:MOST_OBJECTS]
    figures = {part.id: _figure(result, part) for part in shown if part.view is not None}
    rings = {part.id: _ring(result, part) for part in shown if part.selection.any()}
    uris = addresses(list(figures.values()), list(rings.values()), _LIMIT)
    sections = []
    for part, entry in zip(shown, report["objects"], strict=False):
        turned = turntable(f"object-{part.id}", rings[part.id], uris) if part.id in rings else ""
        compared = "<p>No view was drawn: the inputs were found wrong before.</p>"
        if part.id in figures:
            compared = comparison(f"pairing-{part.id}", [figures[part.id]], _PAIRINGS, uris)
        sections.append(
            f'<section id="object-{part.id}"><h2>object {part.id}</h2>{_verdict(part, entry)}<div class="columns">'
            f'<div>{compared}</div><div class="turning">{turned}</div></div></section>'
        )
    counts, seconds = report["counts"], report["seconds"]
    omitted = len(result.objects) - len(shown)
    words = f"<p>The first {len(shown)} of {len(result.objects)} objects are shown.</p>" if omitted else ""
    title = f"Trim of {counts['objects']} objects{_scene(report)}"
    links = "".join(f'<a href="#object-{part.id}">object {part.id}</a>' for part in shown)
    numbers = (
        f'<section><h2>Figures</h2><div class="columns"><div><h3>Gaussians</h3>{table((), list(counts.items()))}</div>'
        f"<div><h3>Time</h3>{bars(seconds, 's')}</div></div></section>"
    )
    body = f"<header><h1>{text(title)}</h1>{words}<nav>{links}</nav></header><main>{''.join(sections)}{numbers}</main>"
    return document(title, body, style=asset("report.css"), script=asset("report.js"))


def _scene(report: Mapping[str, Any]) -> str:
    scene = report["inputs"].get("scene")
    return f" in {Path(str(scene)).name}" if scene else ""


def _verdict(part: TrimmedObject, entry: Mapping[str, Any]) -> str:
    """Whether it was trimmed, what came out, and what may be wrong."""
    doubts = "".join(f"<li>{text(sentence)}</li>" for sentence in entry["warnings"])
    listed = f'<ul class="doubts" role="alert">{doubts}</ul>' if doubts else ""
    if part.refused:
        state = f'<p class="verdict bad" role="alert"><strong>Not trimmed:</strong> {text(part.refused)}.</p>'
        return state + listed
    counts = ", ".join(f"{entry['counts'][name]:,} {name}" for name in _COUNTS)
    given = f"; {part.given_up:,} went to other objects" if part.given_up else ""
    accepted = sum(view["accepted"] for view in entry["views"])
    return (
        f'<p class="verdict"><strong>{len(part.gaussians):,} Gaussians</strong>: {counts}{given}. {accepted} of '
        f"{len(entry['views'])} views accepted; {text(entry['checked']['sentence'])}.</p>{listed}"
    )


def _figure(result: ObjectsResult, part: TrimmedObject) -> Figure:
    """One view of an object, before and after, in the scene and without all objects."""
    assert part.view is not None
    camera, scene = small_camera(part.view.view.camera), result.scene
    near = np.linalg.norm(scene.means - part.bounds.centre.astype(np.float32), axis=1) < _CONTEXT * part.bounds.radius
    left = np.zeros(len(scene), np.bool_)
    left[result.background_rows] = True
    parts = {
        SELECTION: scene.select(part.selection), OBJECT: part.gaussians, SCENE: scene.select(near),
        REST: concatenate([scene.select(near & left), _near(result.outside_parts, part.bounds)]),
    }  # fmt: skip
    pictures = {name: draw_gaussians(drawn, camera, result.used_renderer) for name, drawn in parts.items()}
    doubt = f"rejected: {part.view.rejected}" if part.view.rejected else ""
    return Figure(f"object {part.id}", pictures, doubt)


def _near(gaussians: Gaussians, bounds: Bounds) -> Gaussians:
    offset = gaussians.means - bounds.centre.astype(np.float32)
    return gaussians.select(np.asarray(np.linalg.norm(offset, axis=1) < _CONTEXT * bounds.radius))


def _ring(result: ObjectsResult, part: TrimmedObject) -> Ring:
    """An object from all around, after and before."""
    selection = result.scene.select(part.selection)
    config = PlanConfig(views=FRAMES, size=_SIDE, pitch_degrees=20.0, yaw_range_degrees=(0, 360))
    cameras, _ = plan_cameras(selection, part.bounds.axes[2], config)
    yaws = [360 * i // FRAMES for i in range(FRAMES)]
    ranges = part.report["checked"]["yaw_ranges_degrees"]
    verdicts = [_unchecked(yaw, ranges) for yaw in yaws]
    return draw_ring({OBJECT: part.gaussians, SELECTION: selection}, yaws, cameras, verdicts, result.used_renderer)


def _unchecked(yaw: int, ranges: list[list[int]]) -> str:
    """What is wrong with a side that lies in no range of those that were checked; the last may pass 360.

    >>> _unchecked(5, [[300, 370]]), _unchecked(20, [[300, 370]])
    ('', 'no accepted view from here')
    """
    within = any(first <= angle < last for first, last in ranges for angle in (yaw, yaw + 360))
    return "" if within else "no accepted view from here"
