"""`trim --labels FILE`: several objects of a scene at once."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.console import progress_over_stages
from gaussian_trimmer.commands.remaining import Remaining, read_remaining
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.objects import objects_files, write_objects
from gaussian_trimmer.output.report import RESULTS
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, ids_of
from gaussian_trimmer.selecting.lifting import lift_objects_by_assignment
from gaussian_trimmer.selection_files.several import load_objects
from gaussian_trimmer.trimming.several_objects import trim_objects

if TYPE_CHECKING:
    from gaussian_trimmer.commands.trim import Trim


def trim_labels(command: Trim, console: Console) -> None:
    """Trim all objects that a command names by its labels, and write the results.

    Raises:
        InputError: something that the user gave cannot be used; nothing has been written then.
    """
    assert command.labels is not None
    if command.selection is not None or command.mark_options.marks():
        raise InputError("--labels says what to trim; leave SELECTION and marks out.")
    html = command.pages.html
    if command.pages.export_viewer is not None:
        raise InputError(
            "--export-viewer shows one object; with --labels, convert object_ID files to .html afterwards."
        )
    suffix, folder = command.suffix(), command.folder()
    start = time.perf_counter()
    inputs = [command.scene, *(path for path in (command.labels, command.cameras) if path and path.is_file())]
    results = atomic_folder(
        folder, RESULTS, names=objects_files(suffix, html=html), inputs=inputs, overwrite=command.overwrite
    )  # fmt: skip
    with results as part, progress_over_stages(console) as stage:
        stage("read")
        original = command.read_scene(console)
        cameras = command.read_cameras(console)
        objects = _objects(command, original, cameras)
        remaining = read_remaining(command.remaining, original) if command.remaining else None
        if remaining is not None:
            objects = {number: remaining.of_original(mask, f"object {number}") for number, mask in objects.items()}
        result = trim_objects(
            remaining.scene if remaining else original, objects, config=command.settings(),
            renderer=get_renderer(command.renderer), segmenter=command.make_segmenter(), cameras=cameras,
            excluded=remaining.filled if remaining else None, progress=stage,
        )  # fmt: skip
        stage("write")
        report = write_objects(result, part, suffix, _inputs(command), *_rows(remaining), html=html)
    counts = report["counts"]
    for entry in report["objects"]:
        state = f"not trimmed: {entry['refused']}" if entry["refused"] else f"{entry['gaussians']:,} Gaussians"
        given_up = f", {entry['given_up']:,} went to others" if entry["given_up"] else ""
        console.print(f"object {entry['id']}: {entry['counts']['selected']:,} selected, {state}{given_up}")
    console.print(
        f"{counts['objects']} objects with {counts['in_objects']:,} Gaussians, {counts['contested']:,} of them "
        f"contested; time {time.perf_counter() - start:.1f} s"
    )
    if counts["dropped"]:
        console.print(f"cleaned    {counts['dropped']:,} left out of the background that the objects had hidden")
    console.print(
        f"object_ID{suffix}, background{suffix}, {REPORT if html else 'objects.png'} and the rest are in {folder}."
    )


def _objects(command: Trim, scene: Gaussians, cameras: CameraSet | None) -> dict[int, BoolArray]:
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


def _rows(remaining: Remaining | None) -> tuple[Any, int | None]:
    return (remaining.rows, remaining.n_scene) if remaining else (None, None)


def _inputs(command: Trim) -> dict[str, Any]:
    given = {
        "scene": command.scene,
        "labels": command.labels,
        "cameras": command.cameras,
        "remaining": command.remaining,
    }
    shown = {name: str(path) if isinstance(path, Path) else None for name, path in given.items()}
    return {**shown, "objects": list(command.objects), "preset": command.preset}
