"""What a trim of several objects leaves on disk: a file for each, one background, labels, a report and one picture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.gaussians import Gaussians, IntArray
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.output.html.objects_page import write_objects_page
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.pictures import Picture, captioned, close_up, draw_cells, write_picture
from gaussian_trimmer.output.report import LABEL_NAMES, dropped_of, in_original, labels_of
from gaussian_trimmer.trimming.several_objects import ObjectsResult

_CELL = 240
_OBJECTS_A_ROW = 2
_MAX_DRAWN = 60
_CONTEXT = 1.8


def objects_files(suffix: str, *, html: bool = False) -> tuple[str, ...]:
    """Patterns of the names that `write_objects` writes."""
    names = (f"object_*{suffix}", f"background{suffix}", "labels.npz", "report.json", "objects.png")
    return (*names, REPORT) if html else names


def write_objects(
    result: ObjectsResult, folder: Path, suffix: str, inputs: Mapping[str, Any], rows: IntArray | None = None,
    n_scene: int | None = None, *, html: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Write everything into an existing folder, and return the report.

    Args:
        suffix: ending of the splat files, one of `formats.FORMATS`.
        inputs: where the scene, the labels and so on came from, as JSON holds it.
        rows: row in the original scene of each Gaussian of the result's scene, where that is what an earlier trim left.
        n_scene: number of Gaussians of that original scene.
        html: write `report.html` too, a page to look at.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    for part in result.objects:
        if len(part.gaussians):
            formats.write(part.gaussians, folder / f"object_{part.id}{suffix}")
    if len(result.background_rows) or len(result.outside_parts):
        formats.write_selected(
            result.scene, result.background_rows, result.outside_parts, folder / f"background{suffix}"
        )
    source = in_original(result.source_index, rows)
    buffer = BytesIO()
    np.savez(
        buffer,
        source_index=source.astype(np.int32),
        label=labels_of(result.label, source),
        fitted=result.fitted.astype(np.int32),
        dropped=dropped_of(result.dropped, rows),
        n_object=np.int64(sum(len(part.gaussians) for part in result.objects)),
        object_ids=np.array([part.id for part in result.objects], np.int64),
        object_rows=np.array([len(part.gaussians) for part in result.objects], np.int64),
        n_scene=np.int64(len(result.scene) if n_scene is None else n_scene),
        label_names=np.array(LABEL_NAMES),
    )
    with atomic_file(folder / "labels.npz") as part_file:
        part_file.write_bytes(buffer.getbuffer())
    write_picture(draw_objects(result), folder / "objects.png")
    report = describe_objects(result, inputs)
    with atomic_file(folder / "report.json") as part_file:
        part_file.write_text(json.dumps(report, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if html:
        write_objects_page(result, report, folder)
    return report


def describe_objects(result: ObjectsResult, inputs: Mapping[str, Any]) -> dict[str, Any]:
    """The report as JSON holds it: what all objects share, and the report of each."""
    return {
        "version": __version__,
        "inputs": dict(inputs),
        "counts": {
            "scene": len(result.scene),
            "objects": len(result.objects),
            "in_objects": sum(len(part.gaussians) for part in result.objects),
            "background": len(result.background_rows) + len(result.outside_parts),
            "contested": result.contested,
            "dropped": len(result.dropped),
            "refused": sum(bool(part.refused) for part in result.objects),
        },
        "objects": [
            {"id": part.id, "gaussians": len(part.gaussians), "given_up": part.given_up, **part.report}
            for part in result.objects
        ],
        "seconds": {name: round(time, 4) for name, time in result.seconds.items()},
    }


def draw_objects(result: ObjectsResult) -> Picture:
    """A contact sheet: each object as it was selected, trimmed, and the scene without all objects from there."""
    blocks = []
    for part in [part for part in result.objects if part.view is not None][:_MAX_DRAWN]:
        assert part.view is not None
        camera = close_up(part.view, part.bounds, _CELL)
        scene = result.scene
        around = result.background_rows[
            np.linalg.norm(scene.means[result.background_rows] - part.bounds.centre.astype(np.float32), axis=1)
            < _CONTEXT * part.bounds.radius
        ]
        shown: list[Gaussians] = [scene.select(part.selection), part.gaussians, scene.select(around)]
        state = f"left as it was: {part.refused}" if part.refused else f"{len(part.gaussians):,} Gaussians"
        blocks.append(draw_cells(f"object {part.id}: {state}", shown, camera, result.used_renderer))
    if not blocks:
        return captioned("no selection could be trimmed", np.full((_CELL, 3 * _CELL, 3), 127, np.uint8))
    while len(blocks) % _OBJECTS_A_ROW:
        blocks.append(np.full_like(blocks[0], 32))
    lines = [np.hstack(blocks[i : i + _OBJECTS_A_ROW]) for i in range(0, len(blocks), _OBJECTS_A_ROW)]
    return np.vstack(lines)
