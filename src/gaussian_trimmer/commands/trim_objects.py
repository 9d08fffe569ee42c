"""`trim --labels FILE`: several objects of a scene at once."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.console import print_json, progress_over_stages
from gaussian_trimmer.commands.trim_inputs import TrimInputs
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.html.report_page import REPORT, sentence_of
from gaussian_trimmer.output.report import object_entries
from gaussian_trimmer.output.result import title_of
from gaussian_trimmer.output.saving import PICTURE, RESULTS, result_files, write_trim
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, ids_of
from gaussian_trimmer.selecting.lifting import lift_objects_by_assignment
from gaussian_trimmer.selection_files.several import load_objects
from gaussian_trimmer.trimming.trim import trim_objects

_LISTED = 4


def trim_labels(command: TrimInputs, console: Console) -> None:
    """Trim all objects that a command names by its labels, and write the results.

    Raises:
        InputError: something that the user gave cannot be used; nothing has been written then.
    """
    _refuse_other_options(command)
    suffix, folder, html = command.suffix(), command.folder(), command.pages.html
    start = time.perf_counter()
    given = (command.labels, command.cameras, *command.exclude)
    results = atomic_folder(
        folder,
        RESULTS,
        names=result_files(suffix, several=True, html=html),
        inputs=[command.scene, *(path for path in given if path and path.is_file())],
        overwrite=command.overwrite,
    )
    with results as part, progress_over_stages(console) as stage:
        stage("read")
        scene = command.read_scene(console)
        cameras = command.read_cameras(console)
        excluded = command.excluded_rows(scene)
        result = trim_objects(
            scene,
            _without(excluded, _objects(command, scene, cameras)),
            config=command.settings(),
            renderer=get_renderer(command.renderer),
            segmenter=command.make_segmenter(),
            cameras=cameras,
            excluded=excluded,
            progress=stage,
        )
        stage("write")
        report = write_trim(result, part, suffix, _inputs(command), html=html)
    print_objects(console, report, folder, suffix, start, html=html)
    if command.json:
        print_json(report, (folder, RESULTS))


def print_objects(
    console: Console, report: Mapping[str, Any], folder: Path, suffix: str, start: float, *, html: bool
) -> None:
    """What became of several objects, from their report.

    Args:
        folder: where the results are.
        suffix: ending of their splat files.
        start: when the command began, by `time.perf_counter`.
        html: whether there is a page.
    """
    entries = object_entries(report)
    for entry in entries:
        console.print(_sentence(entry))
    counts, gaussians = report["counts"], sum(entry["gaussians"] for entry in entries)
    shared = f"{counts.get('claimed_by_several', 0):,}"
    console.print(
        f"{len(entries)} objects, {gaussians:,} Gaussians; {shared} claimed by two objects; "
        f"time {time.perf_counter() - start:.1f} s"
    )
    if counts["dropped"]:
        console.print(f"{counts['dropped']:,} Gaussians hidden by the objects were removed from the background.")
    looked_at = REPORT if html else PICTURE
    files = [entry["file"] for entry in entries if entry["file"]]
    listed = ", ".join(files) if len(files) <= _LISTED else f"{files[0]} to {files[-1]}"
    console.print(f"{listed}, background{suffix}, {looked_at} and the rest are in {folder}.")


def _refuse_other_options(command: TrimInputs) -> None:
    """Refuse what a trim of several objects would have to ignore."""
    if command.selection is not None or command.mark_options.marks():
        raise InputError("--labels says what to trim; leave SELECTION and marks out.")
    if command.pages.export_viewer is not None:
        raise InputError("--export-viewer shows one object; after --labels, convert object_ID files to .html.")
    if command.engine is not None:
        raise InputError("--for is for one object; after --labels, convert object_ID files with convert --for.")
    if command.photos is not None:
        raise InputError("--photos is for one object; leave it out, or trim the objects of --labels one by one.")
    if hasattr(command.make_segmenter(), "own_cameras"):
        raise InputError(
            f"The segmenter '{command.segmenter}' has masks of one object; with --labels choose another, or give "
            "--labels a folder of masks whose pixels are ids."
        )


def _without(excluded: BoolArray, objects: dict[int, BoolArray]) -> dict[int, BoolArray]:
    left = {number: mask & ~excluded for number, mask in objects.items()}
    for number, mask in left.items():
        if not mask.any():
            raise InputError(f"Nothing is left of object {number}: --exclude takes all of it; leave a file out.")
    return left


def _sentence(entry: Mapping[str, Any]) -> str:
    """What became of one object."""
    called = title_of(entry["name"])
    if entry["refused"]:
        return f"{called}: not trimmed: {entry['refused']}"
    return f"{called}: {entry['gaussians']:,} Gaussians. {sentence_of(entry['counts'])}."


def _objects(command: TrimInputs, scene: Gaussians, cameras: CameraSet | None) -> dict[int, BoolArray]:
    assert command.labels is not None
    if not command.labels.is_dir():
        return load_objects(command.labels, scene, command.objects, command.selection_options)
    if cameras is None:
        raise InputError("Masks with ids need the cameras of their pictures: --cameras PATH.")
    posed = cameras_with_masks(cameras.pinhole_cameras(), command.labels)
    images = [ids_of(camera, command.labels) for camera in posed]
    labels = lift_objects_by_assignment(scene, posed, images, get_renderer(command.renderer))
    present = [int(number) for number in np.unique(labels) if number > 0]
    if absent := sorted(set(command.objects) - set(present)):
        raise InputError(f"The masks in '{command.labels}' show no object {absent[0]}; they show {present[:24]}.")
    return {number: np.asarray(labels == number) for number in (command.objects or present)}


def _inputs(command: TrimInputs) -> dict[str, Any]:
    return {
        "scene": str(command.scene),
        "level": command.level,
        "labels": str(command.labels),
        "cameras": str(command.cameras) if command.cameras else None,
        "exclude": [str(path) for path in command.exclude],
        "objects": list(command.objects),
        "preset": command.preset,
    }
