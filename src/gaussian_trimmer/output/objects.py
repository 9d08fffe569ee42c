"""What a trim of several objects leaves on disk: a file for each, one background, labels, a report and one picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.io.names import safe_file_name
from gaussian_trimmer.io.writing import write_json
from gaussian_trimmer.output.html.report_page import REPORT, write_report_page
from gaussian_trimmer.output.pictures import (
    Picture,
    captioned,
    close_up,
    draw_cells,
    headed,
    nearby_rows,
    write_picture,
    zoom_to_whole,
    zoomed,
)
from gaussian_trimmer.output.report import count_selected, write_labels
from gaussian_trimmer.trimming.several_objects import ObjectsResult, TrimmedObject

_CELL_PIXELS = 240
_OBJECTS_A_ROW = 2
_MAX_DRAWN = 60
_COLUMN_HEADINGS = ("selection", "trimmed object", "the scene without it")


def objects_files(suffix: str, *, html: bool = False) -> tuple[str, ...]:
    """Patterns of the names that `write_objects` writes."""
    names = (f"object_*{suffix}", f"background{suffix}", "labels.npz", "report.json", "objects.png")
    return (*names, REPORT) if html else names


def write_objects(
    result: ObjectsResult, folder: Path, suffix: str, inputs: Mapping[str, Any], *, html: bool = False
) -> dict[str, Any]:
    """Write everything into an existing folder, and return the report.

    Args:
        result: the objects.
        folder: where to write.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        inputs: where the scene, the labels and so on came from, as JSON holds it.
        html: also write `report.html`, a page to look at.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    report = describe_objects(result, inputs, suffix)
    for part, entry in zip(result.objects, report["objects"], strict=True):
        if entry["file"]:
            formats.write(part.gaussians, folder / entry["file"])
    if len(result.background_rows) or len(result.appended):
        formats.write_selected(result.scene, result.background_rows, result.appended, folder / f"background{suffix}")
    sizes = np.array([len(part.gaussians) for part in result.objects], np.int64)
    write_labels(
        folder / "labels.npz",
        source_index=result.source_index.astype(np.int32),
        label=result.label,
        fitted=result.fitted.astype(np.int32),
        dropped=result.dropped.astype(np.int32),
        n_object=sizes.sum(),
        object_ids=np.array([part.id for part in result.objects], np.int64),
        object_rows=sizes,
        n_scene=np.int64(len(result.scene)),
    )
    write_picture(draw_objects(result), folder / "objects.png")
    write_json(report, folder / "report.json")
    if html:
        write_report_page(result, report, folder)
    return report


def describe_objects(result: ObjectsResult, inputs: Mapping[str, Any], suffix: str = ".ply") -> dict[str, Any]:
    """The report as JSON holds it: what all objects share, and the report of each, with the name of its file."""
    stems = file_stems((part.id, part.name) for part in result.objects)
    return {
        "version": __version__,
        "inputs": dict(inputs),
        "counts": {
            "scene": len(result.scene),
            "objects": len(result.objects),
            "in_objects": sum(len(part.gaussians) for part in result.objects),
            "background": len(result.background_rows) + len(result.appended),
            "claimed_by_several": result.contested,
            "dropped": len(result.dropped),
            "relit": len(result.relit),
            "filled": len(result.filled),
            "refused": sum(bool(part.refused) for part in result.objects),
        },
        "objects": [
            {
                **part.report,
                "id": part.id,
                "name": part.name,
                "file": f"{stems[part.id]}{suffix}" if len(part.gaussians) else None,
                "gaussians": len(part.gaussians),
                "counts": _counts(result, part),
            }
            for part in result.objects
        ],
        "not_filled": list(result.not_filled),
        "seconds": {name: round(time, 4) for name, time in result.seconds.items()},
    }


def file_stems(objects: Iterable[tuple[int, str]]) -> dict[int, str]:
    """Names of objects' files without their endings, by the objects' ids.

    >>> file_stems([(1, "1"), (2, "red mug"), (3, "Red_Mug"), (4, "object 9")])
    {1: 'object_1', 2: 'object_red_mug', 3: 'object_Red_Mug_3', 4: 'object_9'}

    Args:
        objects: ids and names; the name of one without a name is its id.
    """
    stems: dict[int, str] = {}
    for number, name in objects:
        safe = safe_file_name(name)
        stem = safe if safe.startswith("object_") else f"object_{safe}"
        while stem.casefold() in map(str.casefold, stems.values()):
            stem = f"{stem}_{number}"
        stems[number] = stem
    return stems


def _counts(result: ObjectsResult, part: TrimmedObject) -> dict[str, int]:
    """What became of the Gaussians of one selection, each counted once, and how many joined the object."""
    counts = count_selected(part.selection, part.source_index, part.label, result.dropped)
    taken = part.selection & (result.labels > 0) & (result.labels != part.id)
    counts["went_to_other_objects"] = int(np.count_nonzero(taken))
    counts["removed"] -= counts["went_to_other_objects"]
    joined = np.unique(part.source_index)
    return counts | {"recovered": int(np.count_nonzero(~part.selection[joined]))}


def draw_objects(result: ObjectsResult) -> Picture:
    """A contact sheet: each object as it was selected, trimmed, and the scene without all objects, from two sides."""
    blocks = [_block(result, part) for part in result.objects if part.view is not None][:_MAX_DRAWN]
    if not blocks:
        return captioned("no selection could be trimmed", np.full((_CELL_PIXELS, 3 * _CELL_PIXELS, 3), 127, np.uint8))
    while len(blocks) % _OBJECTS_A_ROW:
        blocks.append(np.full_like(blocks[0], 32))
    lines = [np.hstack(blocks[i : i + _OBJECTS_A_ROW]) for i in range(0, len(blocks), _OBJECTS_A_ROW)]
    return np.vstack(lines)


def _block(result: ObjectsResult, part: TrimmedObject) -> Picture:
    assert part.view is not None
    scene = result.scene
    around = nearby_rows(scene, result.background_rows, part.bounds)
    background = concatenate([scene.select(around), result.appended])
    shown = [scene.select(part.selection), part.gaussians, background]
    state = f"not trimmed: {part.refused}" if part.refused else f"{len(part.gaussians):,} Gaussians"
    front, back = (draw_cells(shown, side, result.used_renderer) for side in two_sides(part))
    pictures = np.vstack([headed(_COLUMN_HEADINGS, front), captioned("from the other side", back)])
    return captioned(f"{part.title}: {state}", pictures)


def two_sides(part: TrimmedObject) -> tuple[Camera, Camera]:
    """Two cameras that show the whole object, equally large: from where a view of it looks, and from behind."""
    assert part.view is not None
    camera = close_up(part.view, part.bounds, _CELL_PIXELS)
    sides = camera, _from_behind(camera, part.bounds)
    zoom = min(zoom_to_whole(side, part.gaussians) for side in sides)
    return zoomed(sides[0], zoom), zoomed(sides[1], zoom)


def _from_behind(camera: Camera, bounds: Bounds) -> Camera:
    """The camera after half a turn about the upright axis through the object's centre.

    What lay to the left of the centre lies to the right of it then, so the picture is cut out as far on its other side.
    """
    up, half_turn, mirrored = bounds.axes[2], np.eye(4), np.eye(3)
    half_turn[:3, :3] = 2 * np.outer(up, up) - np.eye(3)
    half_turn[:3, 3] = bounds.centre - half_turn[:3, :3] @ bounds.centre
    centre, _ = camera.project(bounds.centre[None])
    mirrored[0, 2] = camera.width - 2 * float(centre[0, 0])
    return replace(camera, world_to_camera=camera.world_to_camera @ half_turn, K=mirrored @ camera.K)
