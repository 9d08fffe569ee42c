"""From a published data set and the output folder of a method to tasks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, only_training, training_cameras
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, view_of
from gaussian_trimmer.evaluation.layouts.layout import Layout, LayoutTask, camera_of
from gaussian_trimmer.evaluation.predictions import Prediction, PredictionPatterns, find_prediction
from gaussian_trimmer.evaluation.protocols import OWN_RULES, Protocol
from gaussian_trimmer.evaluation.results import read_result
from gaussian_trimmer.evaluation.runs import Task
from gaussian_trimmer.selection_files import SelectionOptions


def chosen_tasks(layout: Layout, root: Path, names: Sequence[str]) -> list[LayoutTask]:
    """The tasks of a data set: those of the given names, or all if none is given.

    Raises:
        InputError: the folder has another layout, or no task has such a name.
    """
    tasks = layout.find_tasks(root)
    known = {task.name for task in tasks}
    for name in names:
        if name not in known:
            raise InputError(f"There is no task '{name}' in '{root}'; available: {', '.join(sorted(known))}.")
    return [task for task in tasks if not names or task.name in names]


def find_predictions(
    tasks: Sequence[LayoutTask], folder: Path, patterns: PredictionPatterns, root: Path
) -> list[Prediction]:
    """The files of every task, found before any is read.

    Raises:
        InputError: the folder does not exist, or the files of a task are not found.
    """
    if not folder.is_dir():
        raise InputError(f"There is no folder '{folder}' of predictions.")
    return [find_prediction(folder, task, patterns, root) for task in tasks]


def dataset_tasks(
    tasks: Sequence[LayoutTask],
    predictions: Sequence[Prediction],
    method: str,
    options: SelectionOptions,
    protocol: Protocol = OWN_RULES,
    ids: Mapping[str, tuple[int, ...]] | None = None,
) -> Iterator[Task]:
    """What is measured, read task by task; a scene that the next task shares is kept.

    Args:
        tasks: the tasks.
        predictions: the files of each.
        method: name of the method.
        options: how selection files are read.
        protocol: how views are rendered and compared.
        ids: ids of the objects by the names of tasks, if selection files hold several.

    Raises:
        InputError: a file cannot be used, a target has no camera of its name, or a result is not of the scene's rows.
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
        yield Task(task.scene, task.object, method, scene, found.selection, found.cut, views, given)


def _views(task: LayoutTask, cameras: Sequence[Camera], path: Path, protocol: Protocol) -> list[TestView]:
    """The ground truth of the targets that count."""
    targets = protocol.targets_of(task).targets
    names = {name for camera in cameras for name in (camera.name, Path(camera.name).stem)}
    if protocol.by_order and len(task.targets) == len(cameras) and names.isdisjoint(t.view for t in task.targets):
        ordered = sorted(cameras, key=lambda camera: camera.name)[-len(targets) :]
    else:
        ordered = [camera_of(target, cameras, f"'{path}'") for target in targets]
    return [
        protocol.view(view_of(camera, target.mask, target.image, category=target.category), camera)
        for camera, target in zip(ordered, targets, strict=True)
    ]
