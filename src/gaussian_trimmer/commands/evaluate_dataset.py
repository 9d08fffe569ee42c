"""`gaussian-trimmer evaluate nvos` and the other data sets: methods before and after trimming."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gaussian_trimmer.commands.arguments import add_stages, config_of, selection_options_of
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import Findings, add_rules, add_tables, judge_of, publish_as
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.datasets import LAYOUTS, MEAN_NOTES, OWN, Layout, Protocol
from gaussian_trimmer.evaluation.metrics import PAIRS, THRESHOLD
from gaussian_trimmer.evaluation.scoring import METRICS, RULES, Judge, Scores, mean_scores
from gaussian_trimmer.evaluation.tables import (
    MADE_BY,
    Cell,
    ScoreTable,
    score_cells,
    table_of_methods,
    table_of_statistics,
    unit_scores,
)
from gaussian_trimmer.evaluation.trials import Run, find_files, measure, read_ids, trials_of, way_of
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.settings import to_plain

ABOUT = {
    "nvos": """Measure methods on NVOS before and after trimming.

ROOT holds masks/<task>/<target>_mask.png. In a method's folder each task has its files in <task>/ or <scene>/:
scene.ply or point_cloud/iteration_*/point_cloud.ply, a selection or object file, and cameras; or name the files
with --scenes, --selections and --cameras.""",
    "lerf-mask": """Measure methods on LERF-Mask before and after trimming.

ROOT holds <scene>/test_mask/<view>/<words>.png with <scene>/images and <scene>/images_train. In a method's folder
each object has its files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.""",
    "lerf-ovs": """Measure methods on LERF-OVS before and after trimming.

ROOT holds label/<scene>/<picture>.json with polygons, and <scene>/images. In a method's folder each object has its
files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.""",
}
"""Names of data sets -> what their commands say."""


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT[parser.command.removeprefix("evaluate ")], lambda arguments: publish_as(arguments, _measure))
    parser.add_argument("root", kind=Path, metavar="ROOT", help="Folder of the data set")
    group = parser.add_argument_group("methods")
    predictions = "Output folders of segmentation methods; a method is called like its folder"
    folders = tuple[Path, ...]
    group.add_argument("--predictions", kind=folders, metavar="DIR ...", required=True, help=predictions)
    group.add_argument("--tasks", kind=tuple[str, ...], metavar="TASK ...", help="Only these tasks")
    scenes = "Pattern of the splat files below a folder of predictions, in which {scene} and {object} stand for the "
    scenes += "task's names; without it the usual places are searched"
    group.add_argument("--scenes", metavar="PATTERN", help=scenes)
    group.add_argument("--selections", metavar="PATTERN", help="The same of the selections or objects")
    group.add_argument("--cameras", metavar="PATTERN", help="The same of the cameras, also in the data set")
    ids = "CSV file with the id of each task's object, or several: rows such as 'ramen/yellow bowl,12 45'"
    group.add_argument("--ids", kind=Path, metavar="FILE", help=ids)
    protocol = "Rules of the comparison: this program's, or those of a published code, which docs/evaluation.md lists"
    group.add_argument("--protocol", metavar="NAME", default=OWN, help=protocol)
    add_rules(parser)
    add_stages(parser.add_argument_group("how to trim"), parser)
    add_tables(parser)


def _measure(arguments: Namespace) -> Findings:
    name, config = arguments.parser.command.removeprefix("evaluate "), config_of(arguments)
    layout, judge = LAYOUTS[name], judge_of(arguments)
    protocol = layout.protocol(arguments.protocol)
    if arguments.protocol != OWN:
        if arguments.threshold not in (THRESHOLD, protocol.threshold):
            raise InputError(
                f"The protocol '{arguments.protocol}' has the threshold {protocol.threshold:g}; leave it out."
            )
        judge = replace(judge, threshold=protocol.threshold)
    methods = _runs(arguments, layout, protocol, judge)
    rules = [judge.describe()] if arguments.protocol == OWN else [protocol.describe()]
    notes = [*rules, f"trimmed with the preset '{arguments.preset}', {config.plan.views} views", MADE_BY]
    notes.append(MEAN_NOTES[layout.mean_over])
    n_tasks = min(map(len, methods.values()))
    if n_tasks != layout.expected and layout.expected is not None:
        notes.append(
            f"{n_tasks} tasks, where {layout.title} has {layout.expected}: means are not comparable with published ones"
        )
    tables = {f"{name}-{method}": table_of_tasks(layout, method, runs, notes) for method, runs in methods.items()}
    metrics = {rule: [name + RULES[rule] for name in ("iou", layout.second)] for rule in protocol.rules}
    with_and_without = f"{layout.title} with and without trimming"
    tables[name] = table_of_methods(with_and_without, methods, metrics, notes, layout.mean_over)
    if arguments.clip:
        tables[f"{name}-clip"] = table_of_methods(
            with_and_without, methods, {"CLIP-IQA": list(PAIRS)}, notes, layout.mean_over
        )
    title, listed = f"{layout.title}: how sure the means are", [name for own in metrics.values() for name in own]
    tables[f"{name}-statistics"] = table_of_statistics(title, methods, listed, notes, layout.mean_over)
    settings = {"protocol": arguments.protocol, "preset": arguments.preset}
    chosen = {"threshold": arguments.threshold, "clip": arguments.clip}
    parts = {"config": config, "rules": chosen, "selection_options": selection_options_of(arguments)}
    found = [run for runs in methods.values() for run in runs]
    return tables, found, settings | {name: to_plain(part) for name, part in parts.items()}


def _runs(arguments: Namespace, layout: Layout, protocol: Protocol, judge: Judge) -> dict[str, list[Run]]:
    """Return the runs of every method."""
    tasks = layout.find_tasks(arguments.root, arguments.tasks)
    folders = {folder.resolve().name: folder for folder in arguments.predictions}
    if not folders or len(folders) < len(arguments.predictions):
        names = ", ".join(folder.name for folder in arguments.predictions) or "none"
        raise InputError(f"Give folders with different names after --predictions; given: {names}.")
    ids = read_ids(arguments.ids, tasks) if arguments.ids else {}
    patterns = {"scene": arguments.scenes, "selection": arguments.selections, "cameras": arguments.cameras}
    found = {
        name: [find_files(task, folder, arguments.root, patterns, bool(ids)) for task in tasks]
        for name, folder in folders.items()
    }
    way = {str(arguments.preset): way_of(config_of(arguments), paper=arguments.preset == "paper")}
    # Lines on the progress belong to no CSV or JSON.
    progress = open_console(quiet=arguments.quiet or arguments.json or arguments.format != "table")
    methods: dict[str, list[Run]] = {name: [] for name in found}
    for name, files in found.items():
        for trial in trials_of(tasks, files, name, selection_options_of(arguments), protocol, ids):
            for run in measure(trial, way, judge, fidelity=False):
                methods[name].append(run)
                progress.print(str(run))
    return methods


def table_of_tasks(layout: Layout, method: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Return a row for each task of one method, and the mean as the data set takes it."""
    metrics = ["iou", "accuracy", "boundary_iou", *(["acc25"] if layout.second == "acc25" else [])]
    names = [name + ending for ending in RULES.values() for name in metrics]
    rows: list[list[Cell]] = []
    for run in runs:
        label = run.object if run.object.startswith(run.scene) else f"{run.scene}/{run.object}"
        rows.append([label, run.views, *score_cells(names, run.before, run.after)])
    if layout.mean_over != "objects":
        scenes = unit_scores(runs, layout.mean_over)
        rows += [[f"{scene}, mean", None, *score_cells(names, *pair)] for scene, pair in scenes.items()]
    rows.append(["mean", None, *score_cells(names, *_mean_of(layout, runs))])
    columns = ["task", "views", *(f"{METRICS[name]} {rule} (%)" for rule in RULES for name in metrics)]
    return ScoreTable(f"{layout.title}: {method} before -> after trimming", columns, rows, notes)


def _mean_of(layout: Layout, runs: Sequence[Run]) -> tuple[Scores, Scores]:
    """Return scores before and after, averaged as the data set does."""
    units = unit_scores(runs, layout.mean_over).values()
    return mean_scores(before for before, _ in units), mean_scores(after for _, after in units)
