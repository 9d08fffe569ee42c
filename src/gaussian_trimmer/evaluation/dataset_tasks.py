"""From a published data set and the output folder of a method to trials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, only_training, training_cameras
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, view_of
from gaussian_trimmer.evaluation.layouts import DatasetTask, Layout, camera_of
from gaussian_trimmer.evaluation.predictions import Prediction
from gaussian_trimmer.evaluation.protocols import OWN_RULES, Protocol
from gaussian_trimmer.evaluation.results import read_result
from gaussian_trimmer.evaluation.runs import Trial
from gaussian_trimmer.selection_files import SelectionOptions


def chosen_tasks(layout: Layout, root: Path, names: Sequence[str]) -> list[DatasetTask]:
    """Return the tasks of a data set: those of the given names, or all if none is given.

    Raises:
        InputError: the folder has another layout, or no task has such a name.
    """
    tasks = layout.find_tasks(root)
    known = {task.name for task in tasks}
    for name in names:
        if name not in known:
            raise InputError(f"There is no task '{name}' in '{root}'; available: {', '.join(sorted(known))}.")
    return [task for task in tasks if not names or task.name in names]


def trials_of(
    tasks: Sequence[DatasetTask],
    predictions: Sequence[Prediction],
    method: str,
    options: SelectionOptions,
    protocol: Protocol = OWN_RULES,
    ids: Mapping[str, tuple[int, ...]] | None = None,
) -> Iterator[Trial]:
    """Yield what is measured, read task by task; a scene that the next task shares is kept.

    Args:
        tasks: the tasks.
        predictions: the files of each.
        method: name of the method.
        options: how selection files are read.
        protocol: how views are rendered and compared.
        ids: ids of the objects by the names of tasks, if selection files hold several.

    Raises:
        InputError: a file cannot be used, a picture has no camera of its name, or a result is not of the scene's rows.
    """
    path, scene = None, None
    for task, prediction in zip(tasks, predictions, strict=True):
        if scene is None or path != prediction.scene:
            path, scene = prediction.scene, formats.read(prediction.scene)
        if ids:
            options = replace(options, object_id=ids[task.name])
        listed = read_camera_set(prediction.cameras)
        views = _views(task, listed.pinhole_cameras(), prediction.cameras, protocol)
        found = read_result(prediction.selection, scene, options)
        if found.selection is None:
            raise InputError(f"The trimmer cannot start from '{prediction.selection}': {found.unknown_background}")
        given = only_training(listed) if training_cameras(listed) else None
        yield Trial(task.scene, task.object, method, scene, found.selection, found.cut, views, given)


def _views(task: DatasetTask, cameras: Sequence[Camera], path: Path, protocol: Protocol) -> list[TestView]:
    """Return the ground truth of the pictures that count."""
    pictures = protocol.counted(task).pictures
    names = {name for camera in cameras for name in (camera.name, Path(camera.name).stem)}
    if protocol.by_order and len(task.pictures) == len(cameras) and names.isdisjoint(p.view for p in task.pictures):
        ordered = sorted(cameras, key=lambda camera: camera.name)[-len(pictures) :]
    else:
        ordered = [camera_of(picture, cameras, f"'{path}'") for picture in pictures]
    return [
        protocol.view(view_of(camera, picture.mask, picture.image, category=picture.category), camera)
        for camera, picture in zip(ordered, pictures, strict=True)
    ]
