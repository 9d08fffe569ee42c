"""All that a trim leaves on disk: splat files, labels, pictures, a report, and a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.glb import write_objects
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.io.writing import write_json, write_table, write_whole
from gaussian_trimmer.output.engines import PlacingOptions
from gaussian_trimmer.output.pages import report_page
from gaussian_trimmer.output.pictures import draw_before_after, draw_view, write_picture
from gaussian_trimmer.output.report import SUMMARY, changed_settings, describe, file_stems, summary_rows
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.trimming.result import RowLabel, TrimResult
from gaussian_trimmer.views.view import TrimmedView

RESULTS = "trim"
"""What the manifest of a folder calls these results."""
PICTURE, PAGE = "before_after.png", "report.html"
"""Names of the picture of all objects, and of the page."""
ALL_OBJECTS = "objects.glb"
"""Several objects in one file: a node each, named, with the foot at its origin. Written where their files are .glb."""
LABEL_NAMES = tuple(label.name.lower() for label in RowLabel)
"""Names of the labels of rows, by number."""


def save(
    result: TrimResult, folder: str | Path, *, overwrite: bool = False, format: str | None = None, html: bool = False
) -> Path:
    """Write what the command line writes, and return the folder, which appears whole or not at all.

    That is objects and background as splat files, `labels.npz`, `report.json`, `summary.csv`, `before_after.png` and,
    of one object, `views/`. Where nothing was trimmed, or nothing is left, no background is written.

    Args:
        result: the trim.
        folder: new or empty; missing parents are made.
        overwrite: replace earlier results in the folder.
        format: ending of the splat files: ply (the default), compressed.ply, splat, spz, sog or glb.
        html: also write `report.html`, a page about the trim that any browser opens.

    Raises:
        InputError: the folder holds something and `overwrite` is not set, it cannot be written to, no format has
            that name, or the format cannot hold the Gaussians.
    """
    if not isinstance(result, TrimResult):
        raise InputError(f"The result is a {type(result).__name__}; give what gaussian_trimmer.trim returns.")
    folder, suffix = Path(folder), suffix_of(format or "ply")
    with atomic_folder(folder, RESULTS, names=result_files(suffix, html=html), overwrite=overwrite) as part:
        report = describe(result, suffix=suffix)
        write_trim(result, report | {"call": _call(result, report)}, part, suffix, html=html)
    return folder


def _call(result: TrimResult, report: Mapping[str, Any]) -> str:
    """Return the call in Python that makes a trim, with every setting that is not the default."""
    what = "trim(scene, selection" if len(result.objects) == 1 else "trim_objects(scene, objects"
    settings = changed_settings(report["configuration"])
    config = f", config=gaussian_trimmer.TrimConfig.of({settings!r})" if settings else ""
    return f"gaussian_trimmer.{what}{', cameras=cameras' if result.cameras else ''}{config})"


def write_trim(
    result: TrimResult,
    report: Mapping[str, Any],
    folder: Path,
    suffix: str = ".ply",
    *,
    background: bool = True,
    html: bool = False,
) -> None:
    """Write everything into an existing folder.

    Args:
        result: the trim.
        report: what `describe` returns.
        folder: where to write.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        background: write the background too, which is nearly as large as the scene. It is not written where nothing was
            trimmed, or without a single Gaussian, as an object that was given alone can leave it.
        html: also write `report.html`.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    before_after, background = draw_before_after(result), background and not result.nothing_trimmed
    files: list[Callable[[], None]] = [
        lambda: write_picture(before_after, folder / PICTURE),
        lambda: _write_splats(result, folder, suffix, background),
        lambda: _write_labels(result, folder / "labels.npz"),
        lambda: write_json(report, folder / "report.json"),
        lambda: write_table(summary_rows(report), folder / SUMMARY, for_people=True),
    ]
    if len(result.objects) == 1:
        (folder / "views").mkdir()
        files += [partial(_write_view, view, i, folder / "views") for i, view in enumerate(result.objects[0].views)]
    for _ in parallel_map(lambda write: write(), files):
        pass
    if html:
        write_whole(folder / PAGE, report_page(result, report))


def result_files(suffix: str, *, html: bool = False) -> tuple[str, ...]:
    """Return patterns of the names of all files that are written, by the ending of the splat files."""
    names = (f"object{suffix}", f"object_*{suffix}", "views/[0-9][0-9].png", f"background{suffix}", "labels.npz")
    together = [ALL_OBJECTS] if suffix == ".glb" else []
    return (*names, "report.json", SUMMARY, PICTURE, *together, *([PAGE] if html else []))


def suffix_of(format: str) -> str:
    """Return the ending of files of a format, whose name may be given with or without a leading dot.

    Raises:
        InputError: no format has that name.

    >>> suffix_of("Compressed.PLY")
    '.compressed.ply'
    """
    suffix = f".{format.lower().lstrip('.')}"
    if suffix not in formats.FORMATS:
        known = ", ".join(name.lstrip(".") for name in formats.FORMATS)
        raise InputError(f"Unknown format '{format}'; available: {known}.")
    return suffix


def _write_splats(result: TrimResult, folder: Path, suffix: str, background: bool) -> None:
    stems = file_stems((part.id, part.name) for part in result.objects)
    for part in result.objects:
        if len(part.gaussians) or len(result.objects) == 1:
            formats.write(part.gaussians, folder / f"{stems[part.id]}{suffix}")
    filled = [part for part in result.objects if len(part.gaussians)]
    if suffix == ".glb" and len(filled) > 1:
        options = PlacingOptions(origin="foot")
        nodes = [(part.title, part.gaussians, options.placement(part.gaussians, part.up.direction)) for part in filled]
        write_objects([(name, found, place.origin) for name, found, place in nodes], folder / ALL_OBJECTS)
    if background and len(result.background_source):
        formats.write_selected(result.scene, result.rest.rows, result.rest.appended, folder / f"background{suffix}")


def _write_view(view: TrimmedView, number: int, folder: Path) -> None:
    write_picture(draw_view(view, number), folder / f"{number:02d}.png")


def _write_labels(result: TrimResult, path: Path) -> None:
    """Write which scene row each row of the files is, the objects' first, and what happened to it."""
    objects, sizes = result.objects, np.array([len(part.gaussians) for part in result.objects], np.int64)
    starts = np.cumsum(sizes) - sizes
    arrays: dict[str, Any] = {
        "source_index": np.concatenate([*(part.source_index for part in objects), result.background_source]),
        "fitted": np.concatenate([start + part.fitted for start, part in zip(starts, objects, strict=True)]),
        "discarded": result.discarded,
    }
    if len(objects) == 1:
        arrays["selected"] = objects[0].selected_rows
    arrays = {name: array.astype(np.int32) for name, array in arrays.items()}
    # Into memory first: `np.savez` does not notice everywhere that a disk is full.
    buffer = BytesIO()
    np.savez(
        buffer,
        **arrays,
        label=np.concatenate([*(part.label for part in objects), result.background_label]),
        n_object=sizes.sum(),
        object_ids=np.array([part.id for part in objects], np.int64),
        object_rows=sizes,
        n_scene=np.int64(len(result.scene)),
        label_names=np.array(LABEL_NAMES),
    )
    write_whole(path, buffer.getbuffer())
