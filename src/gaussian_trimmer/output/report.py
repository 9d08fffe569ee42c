"""What a trim leaves on disk: two splat files, labels, pictures, and a report of how they came about."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.output.checked_sides import checked_sides
from gaussian_trimmer.output.pictures import draw_before_after, draw_view, write_picture
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import RowLabel, TrimResult

LABEL_NAMES = tuple(label.name.lower() for label in RowLabel)
"""Names of the labels of rows, by number."""
RESULTS = "trim"
"""What the manifest of a folder calls these results."""


def result_files(suffix: str) -> tuple[str, ...]:
    """Patterns of the names that `write_results` writes."""
    splats = (f"object{suffix}", f"background{suffix}")
    return (*splats, "labels.npz", "report.json", "before_after.png", "views/[0-9][0-9].png")


def write_results(
    result: TrimResult, selection: BoolArray, report: Mapping[str, Any], folder: Path, renderer: Renderer,
    suffix: str = ".ply", rows: IntArray | None = None, n_scene: int | None = None, *, background: bool = True,
) -> None:  # fmt: skip
    """Write everything into an existing folder.

    Args:
        result: the trim.
        selection: the coarse object, (N,).
        report: what `describe` returns.
        folder: where to write.
        renderer: draws the pictures.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        background: write the background too, which is nearly as large as the scene.
        rows: row in the original scene of each Gaussian of the result's scene, where that is what an earlier trim left.
        n_scene: number of Gaussians of that original scene.

    A background without a single Gaussian, as an object that was given alone can leave, is not written.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    formats.write(result.object, folder / f"object{suffix}")
    if background and len(result.source_index) > len(result.object):
        formats.write_selected(result.scene, result.background_rows, result.appended, folder / f"background{suffix}")
    source = in_original(result.source_index, rows)
    with atomic_file(folder / "labels.npz") as part, part.open("wb") as file:
        np.savez(
            file,
            source_index=source.astype(np.int32),
            label=labels_of(result.label, source),
            n_object=np.int64(len(result.object)),
            fitted=result.fitted.astype(np.int32),
            dropped=dropped_of(result.dropped, rows),
            selected=in_original(np.flatnonzero(selection), rows).astype(np.int32),
            label_names=np.array(LABEL_NAMES),
            n_scene=np.int64(len(result.scene) if n_scene is None else n_scene),
        )
    (folder / "views").mkdir()
    for i, view in enumerate(result.views):
        write_picture(draw_view(view, i), folder / "views" / f"{i:02d}.png")
    write_picture(draw_before_after(result, selection, renderer), folder / "before_after.png")
    with atomic_file(folder / "report.json") as part:
        part.write_text(json.dumps(report, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def describe(
    result: TrimResult,
    selection: BoolArray,
    config: TrimConfig,
    inputs: Mapping[str, Any],
    segmenter: str = "",
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The report as JSON holds it.

    Args:
        result: the trim.
        selection: the coarse object, (N,).
        config: the settings that it was made with.
        inputs: where the scene, the selection and so on came from, as JSON holds it.
        segmenter: a fuller description of the segmenter than its name.
        seconds: time taken outside the trimmer, by stage.
    """
    return {
        "version": __version__,
        "inputs": dict(inputs),
        "configuration": asdict(config),
        "renderer": result.renderer,
        "segmenter": segmenter or result.segmenter,
        "up": {
            "direction": result.up.direction.tolist(),
            "source": result.up.source,
            "confidence": round(result.up.confidence, 4),
        },
        "bounds": {
            "centre": result.bounds.centre.tolist(),
            "half_extents": result.bounds.half_extents.tolist(),
            "axes": result.bounds.axes.tolist(),
        },
        "views": [
            {"accepted": not view.rejected, "reason": view.rejected or "", **_camera_entry(view.view.camera)}
            for view in result.views
        ],
        "checked": checked_sides(result).as_json(),
        "refused": result.refused or "",
        "not_fitted": result.not_fitted or "",
        "warnings": list(result.warnings),
        "counts": count(result, selection),
        "seconds": {stage: round(time, 4) for stage, time in {**(seconds or {}), **result.seconds}.items()},
    }


def count(result: TrimResult, selection: BoolArray) -> dict[str, int]:
    """Numbers of Gaussians: of the inputs and outputs, and of what was done to them.

    `kept` and `recovered` are whole Gaussians of the object, `split` the parts of split ones in it, `fitted` those
    of all these whose numbers are not the scene's; `pruned` ones left
    the coarse selection, `floaters` among them for lying far from the object.
    """
    ours, labels = result.label[: len(result.object)], result.label
    return {
        "scene": len(result.scene),
        "selected": int(np.count_nonzero(selection)),
        "kept": int(np.count_nonzero(ours == RowLabel.KEPT)),
        "split": int(np.count_nonzero(ours == RowLabel.SPLIT_INSIDE)),
        "fitted": len(result.fitted),
        "recovered": int(np.count_nonzero(ours == RowLabel.RECOVERED)),
        "pruned": int(np.count_nonzero(labels == RowLabel.PRUNED)),
        "floaters": result.floaters,
        "dropped": len(result.dropped),
        "filled": int(np.count_nonzero(labels == RowLabel.FILLED)),
        "object": len(result.object),
        "background": len(result.source_index) - len(result.object),
    }


def labels_of(label: NDArray[np.uint8], source: IntArray) -> NDArray[np.uint8]:
    """Labels of output rows; what an earlier trim filled in has no row in the original scene, and stays filled."""
    return np.where(source < 0, RowLabel.FILLED, label).astype(np.uint8)


def dropped_of(dropped: IntArray, rows: IntArray | None) -> NDArray[np.int32]:
    """Rows of the original scene that were dropped; of what an earlier trim filled in there is none."""
    found = in_original(dropped, rows)
    return found[found >= 0].astype(np.int32)


def in_original(found: IntArray, rows: IntArray | None) -> IntArray:
    """Rows of the original scene for rows of the result's scene; -1, of what is new, stays."""
    return found if rows is None else np.where(found < 0, found, rows[found])


def _camera_entry(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }
