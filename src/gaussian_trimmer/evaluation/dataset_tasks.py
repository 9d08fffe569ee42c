"""From a published data set and a method's output folder to tasks, and from their runs to the tables of the field."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training, training_cameras
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.clip_iqa import PAIRS
from gaussian_trimmer.evaluation.ground_truth import view_of
from gaussian_trimmer.evaluation.layouts import Layout
from gaussian_trimmer.evaluation.layouts.tasks import LayoutTask, camera_of
from gaussian_trimmer.evaluation.predictions import Prediction, PredictionPatterns, find_prediction
from gaussian_trimmer.evaluation.results import read_result
from gaussian_trimmer.evaluation.runs import Run, Task
from gaussian_trimmer.evaluation.scoring import Scores, mean_scores
from gaussian_trimmer.evaluation.tables import Cell, Change, ScoreTable, heading
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.selection_files import SelectionOptions

_RULES = {"alone": "alone", "in-scene": "in scene"}
_SHOWN = {"iou": "IoU", "accuracy": "accuracy", "boundary_iou": "boundary IoU"}


def chosen_tasks(layout: Layout, root: Path, names: Sequence[str]) -> list[LayoutTask]:
    """The tasks of a data set, all or those of the given names.

    Raises:
        InputError: the folder has another layout, or no task has such a name.
    """
    tasks = layout.find_tasks(root)
    known = {task.name for task in tasks}
    for name in names:
        if name not in known:
            raise InputError(f"There is no task '{name}' in '{root}'; there are: {', '.join(sorted(known))}.")
    return [task for task in tasks if not names or task.name in names]


def find_predictions(
    tasks: Sequence[LayoutTask], folder: Path, patterns: PredictionPatterns, root: Path
) -> list[Prediction]:
    """The files of every task, before any is read.

    Raises:
        InputError: the folder does not exist, or the files of a task are not found.
    """
    if not folder.is_dir():
        raise InputError(f"There is no folder '{folder}' of predictions.")
    return [find_prediction(folder, task, patterns, root) for task in tasks]


def dataset_tasks(
    tasks: Sequence[LayoutTask], predictions: Sequence[Prediction], method: str, options: SelectionOptions
) -> Iterator[Task]:
    """Everything that is measured, read task by task; a scene that the next task shares is kept.

    Raises:
        InputError: a file cannot be used, a target has no camera of its name, or a result is not of the scene's rows.
    """
    read: tuple[Path, Gaussians] | None = None
    for task, prediction in zip(tasks, predictions, strict=True):
        if read is None or read[0] != prediction.scene:
            read = prediction.scene, formats.read(prediction.scene)
        yield _task(task, prediction, read[1], method, options)


def _task(task: LayoutTask, prediction: Prediction, scene: Gaussians, method: str, options: SelectionOptions) -> Task:
    listed = read_camera_set(prediction.cameras)
    cameras = listed.pinhole_cameras()
    where = f"'{prediction.cameras}'"
    views = [view_of(camera_of(target, cameras, where), target.mask, target.image) for target in task.targets]
    found = read_result(prediction.selection, scene, options)
    if found.selection is None:
        raise InputError(f"The trimmer cannot start from '{prediction.selection}': {found.unknown_background}")
    given = only_training(listed) if training_cameras(listed) else None
    return Task(task.scene, task.object, method, scene, found.selection, found.cut, views, given)


def table_of_tasks(layout: Layout, method: str, variant: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """A row for each task, by both rules of occlusion, and the mean as the data set takes it."""
    names = list(dict.fromkeys((run.scene, run.object) for run in runs))
    rules = [rule for rule in _RULES if any(run.occlusion == rule for run in runs)]
    rows: list[list[Cell]] = []
    for scene, name in names:
        of_task = {run.occlusion: run for run in runs if (run.scene, run.object) == (scene, name)}
        views = len(of_task[rules[0]].views)
        label = name if name.startswith(scene) else f"{scene}/{name}"
        rows.append([label, views, *_cells([(of_task[rule].before, of_task[rule].after) for rule in rules])])
    if layout.MEAN == "scenes":
        for scene in dict.fromkeys(run.scene for run in runs):
            rows.append([f"{scene}, mean", None, *_cells([_scene_mean(runs, scene, rule) for rule in rules])])
    rows.append(["mean", None, *_cells([mean_of(layout, runs, rule) for rule in rules])])
    columns = ["task", "views", *(f"{_SHOWN[m]} {_RULES[rule]} (%)" for rule in rules for m in _SHOWN)]
    title = f"{layout.TITLE}: {method} before -> after {variant}"
    return ScoreTable(title, columns, rows, [*notes, *_notes_on(layout, len(names))])


def table_beside_published(layout: Layout, methods: dict[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """The methods' means before and after, beside published ones: each method has a row for each rule of occlusion."""
    second = "boundary_iou" if layout.MEAN == "scenes" else "accuracy"
    rows: list[list[Cell]] = [
        [row.method, "published", Change(row.iou, row.trimmed_iou), Change(row.second, row.trimmed_second)]
        for row in layout.PUBLISHED
    ]
    for method, runs in methods.items():
        for rule in dict.fromkeys(run.occlusion for run in runs):
            before, after = mean_of(layout, runs, rule)
            cells = (Change(before[name], after[name]) for name in ("iou", second))
            rows.append([method, f"measured, {_RULES[rule]}", *cells])
    columns = ["method", "figures", "mIoU (%)", "mBIoU (%)" if second == "boundary_iou" else "mAcc (%)"]
    counted = {len({(run.scene, run.object) for run in runs}) for runs in methods.values()}
    title = f"{layout.TITLE} with and without trimming"
    return ScoreTable(title, columns, rows, [*notes, *_notes_on(layout, min(counted, default=0))], digits=1)


def table_of_looks(layout: Layout, methods: dict[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """CLIP-IQA of the methods' objects, before and after, beside published figures."""
    rows: list[list[Cell]] = [
        [row.method, "published", *(Change(*pair) for pair in row.looks)] for row in layout.PUBLISHED if row.looks
    ]
    for method, runs in methods.items():
        before, after = mean_of(layout, runs, "alone")
        rows.append([method, "measured", *(Change(before.get(name), after.get(name)) for name in PAIRS)])
    columns = ["method", "figures", *(heading(name) for name in PAIRS)]
    unknown = "the model of the published figures is not known to be the same"
    return ScoreTable(f"{layout.TITLE}: CLIP-IQA with and without trimming", columns, rows, [*notes, unknown], digits=1)


def mean_of(layout: Layout, runs: Sequence[Run], rule: str) -> tuple[Scores, Scores]:
    """Scores before and after under one rule, as the data set takes its mean."""
    if layout.MEAN == "tasks":
        chosen = [run for run in runs if run.occlusion == rule]
        return mean_scores(run.before for run in chosen), mean_scores(run.after for run in chosen)
    means = [_scene_mean(runs, scene, rule) for scene in dict.fromkeys(run.scene for run in runs)]
    return mean_scores(before for before, _ in means), mean_scores(after for _, after in means)


def _scene_mean(runs: Sequence[Run], scene: str, rule: str) -> tuple[Scores, Scores]:
    chosen = [run for run in runs if (run.scene, run.occlusion) == (scene, rule)]
    return mean_scores(run.before for run in chosen), mean_scores(run.after for run in chosen)


def _cells(pairs: Sequence[tuple[Scores, Scores]]) -> list[Cell]:
    return [Change(before.get(name), after.get(name)) for before, after in pairs for name in _SHOWN]


def _notes_on(layout: Layout, n_tasks: int) -> list[str]:
    mean = "tasks" if layout.MEAN == "tasks" else "objects of a scene, then over scenes"
    notes = [f"mean over the views of a task, then over {mean}; masks of another size than the camera's picture are "
             "rendered at theirs"]  # fmt: skip
    if n_tasks != layout.EXPECTED:
        notes.append(
            f"{n_tasks} tasks, where {layout.TITLE} has {layout.EXPECTED}: means are not comparable with published ones"
        )
    if not layout.PUBLISHED:
        notes.append("no published figures are recorded for this data set")
    return notes
