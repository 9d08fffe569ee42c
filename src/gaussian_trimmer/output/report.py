"""What a trim leaves on disk: two splat files, labels, pictures, and a report of how they came about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.io.writing import write_json, write_whole
from gaussian_trimmer.output.checked_sides import checked_sides
from gaussian_trimmer.output.pictures import draw_before_after, draw_view, write_picture
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.result import RowLabel, TrimResult
from gaussian_trimmer.views import TrimmedView

LABEL_NAMES = tuple(label.name.lower() for label in RowLabel)
"""Names of the labels of rows, by number."""
RESULTS = "trim"
"""What the manifest of a folder calls these results."""


def result_files(suffix: str) -> tuple[str, ...]:
    """Patterns of the names that `write_results` writes."""
    splats = (f"object{suffix}", f"background{suffix}")
    return (*splats, "labels.npz", "report.json", "before_after.png", "views/[0-9][0-9].png")


def write_results(
    result: TrimResult, report: Mapping[str, Any], folder: Path, suffix: str = ".ply", *, background: bool = True
) -> None:
    """Write a trim into an existing folder.

    Args:
        result: the trim.
        report: what `describe` returns.
        folder: where to write.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        background: write the background too, which is nearly as large as the scene. Without a single Gaussian, as an
            object that was given alone can leave it, it is not written.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    (folder / "views").mkdir()
    before_after = draw_before_after(result)
    files = [
        lambda: write_picture(before_after, folder / "before_after.png"),
        lambda: _write_splats(result, folder, suffix, background),
        *(partial(_write_view, view, i, folder / "views") for i, view in enumerate(result.views)),
        lambda: write_labels(
            folder / "labels.npz",
            source_index=result.source_index.astype(np.int32),
            label=result.label,
            n_object=np.int64(len(result.object)),
            fitted=result.fitted.astype(np.int32),
            dropped=result.dropped.astype(np.int32),
            selected=np.flatnonzero(result.selection).astype(np.int32),
            n_scene=np.int64(len(result.scene)),
        ),
        lambda: write_json(report, folder / "report.json"),
    ]
    for _ in parallel_map(lambda write: write(), files):
        pass


def _write_splats(result: TrimResult, folder: Path, suffix: str, background: bool) -> None:
    formats.write(result.object, folder / f"object{suffix}")
    if background and len(result.source_index) > len(result.object):
        formats.write_selected(result.scene, result.background_rows, result.appended, folder / f"background{suffix}")


def _write_view(view: TrimmedView, number: int, folder: Path) -> None:
    write_picture(draw_view(view, number), folder / f"{number:02d}.png")


def write_labels(path: Path, **arrays: Any) -> None:
    """Write the arrays of `labels.npz`, and the names of the labels."""
    # Into memory first: `np.savez` does not notice everywhere that a disk is full.
    buffer = BytesIO()
    np.savez(buffer, **arrays, label_names=np.array(LABEL_NAMES))
    write_whole(path, buffer.getbuffer())


def describe(
    result: TrimResult, inputs: Mapping[str, Any] | None = None, seconds: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """The report of a trim, as JSON holds it.

    Args:
        result: the trim.
        inputs: where the scene, the selection and so on came from, as JSON holds it.
        seconds: time taken outside the trimmer, by stage.
    """
    return {
        "version": __version__,
        "inputs": dict(inputs or {}),
        "configuration": asdict(result.config),
        "renderer": result.renderer,
        "segmenter": result.segmenter_description or result.segmenter,
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
            {"accepted": not view.rejected, "reason": view.rejected or None, **_camera_entry(view.view.camera)}
            for view in result.views
        ],
        "checked": checked_sides(result).as_json(),
        "refused": result.refused or None,
        "not_fitted": result.not_fitted or None,
        "not_filled": result.not_filled or None,
        "warnings": list(result.warnings),
        "counts": count(result),
        "seconds": {stage: round(time, 4) for stage, time in {**(seconds or {}), **result.seconds}.items()},
    }


def count(result: TrimResult) -> dict[str, int]:
    """Numbers of Gaussians: of the scene, of what became of the selected ones, and of rows of both files.

    Every selected Gaussian is counted once: it was kept, cut (the object has parts of it), removed (it is in the
    background) or left out (of both files). `recovered` ones joined the object, `split` ones left a part in the
    background, `floaters` are removed ones that lay far off, and `dropped` counts all that are in neither file.
    `object`, `background`, `fitted`, `relit` and `filled` count rows of the files, where a Gaussian may have several.
    """
    n_object = len(result.object)
    rows, label = result.source_index[:n_object], result.label[:n_object]
    return {
        "scene": len(result.scene),
        **count_selected(result.selection, rows, label, result.dropped),
        "recovered": int(np.count_nonzero(result.object_mask & ~result.selection)),
        "split": len(np.unique(result.source_index[result.label == RowLabel.SPLIT_OUTSIDE])),
        "fitted": len(result.fitted),
        "floaters": result.floaters,
        "dropped": len(result.dropped),
        "relit": result.count(RowLabel.RELIT),
        "filled": result.count(RowLabel.FILLED),
        "object": n_object,
        "background": len(result.source_index) - n_object,
    }


def count_selected(selection: BoolArray, rows: IntArray, label: NDArray[np.uint8], dropped: IntArray) -> dict[str, int]:
    """What became of the selected Gaussians, each counted once.

    Args:
        selection: the selection, (N,).
        rows: scene row of each row of the object, (M,).
        label: what happened to each of these, a `RowLabel`, (M,).
        dropped: scene rows that are in neither file.
    """
    left = selection.copy()
    counts = {"selected": int(np.count_nonzero(selection))}
    cut = rows[label == RowLabel.SPLIT_INSIDE]
    for name, taken in (("cut", cut), ("kept", rows), ("left_out", dropped)):
        counts[name] = int(np.count_nonzero(left[np.unique(taken)]))
        left[taken] = False
    return counts | {"removed": int(np.count_nonzero(left))}


def _camera_entry(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }
