"""What `trim`, `select --trim` and `objects --trim` have in common: read a scene, trim in it, write and say results."""

from __future__ import annotations

import re
import time
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands import parser_of
from gaussian_trimmer.commands.arguments import config_of, placing_of, suffix_for
from gaussian_trimmer.commands.console import (
    add_printing,
    announce_compiling,
    print_json,
    print_warnings,
    progress_over_stages,
)
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.masks.mask_files import read_masks
from gaussian_trimmer.masks.sam import draw_masks
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import PAGE, PICTURE, RESULTS, result_files, write_trim
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.selecting.marks import Click, write_marks
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import THE_OBJECT, TrimResult, title_of
from gaussian_trimmer.trimming.trim import trim_objects
from gaussian_trimmer.trimming.up_vector import UpVector

Selected = tuple[Gaussians, CameraSet | None, Any, UpVector | None, BoolArray | None]
"""What a trim begins with: scene, cameras, objects as `trim_objects` takes them, the up vector of the whole scene if it
was looked for (if it is sure, no object searches for its own), and which Gaussians join no object, (N,)."""
NOTHING_TRIMMED = 3
"""Exit code where the inputs could be read, but the selections were written unchanged."""
MARKS = "selection.json"
"""Name of the file of marks among the results."""
NOT_REPEATED = ("output", "overwrite", "quiet", "json", "log_level", "config_file")
_LISTED = 4
_NAMES_OF_ALL = re.compile(r"scene|splats?|point_cloud|iteration_\d+|meta|lod-meta|output", re.IGNORECASE)
"""What trainings and converters call every scene's file, and the folders around it."""


def add_results(parser: Parser, output: str, help: str) -> Any:
    """Add where results go, and what is printed; return the group of these arguments."""
    group = parser.add_argument_group("results")
    group.add_argument("--output", kind=Path, metavar=output, help=help)
    group.add_argument(
        "--overwrite", kind=bool, help="Replace earlier results; other files in the folder are left alone"
    )
    add_printing(group, log=True)
    return group


def scene_name(scene: Path) -> str:
    """Return what a scene is called: its file without endings, or the folder of one that is called as all are."""
    names = [part.split(".")[0] for part in scene.parts if part not in ("/", ".", "..")]
    own = [name for name in names if not _NAMES_OF_ALL.fullmatch(name)]
    return [scene.resolve().name, *names[-1:], *own][-1]


def read_scene(
    arguments: Namespace, console: Console, read: Callable[..., Gaussians] | None = None
) -> tuple[Gaussians, CameraSet | None]:
    """Return the Gaussians and, in their coordinates, the cameras if they are given; what is read is said.

    Raises:
        InputError: a file cannot be read.
    """
    cameras = None
    if arguments.cameras is not None:  # first, since wrong ones are soon found
        found, trusted = identify(arguments.scene).scene, arguments.trust_paths
        cameras = read_cameras_of(found, arguments.cameras, trust_paths=trusted, say=console.print)
    return (read or formats.read)(arguments.scene, level=arguments.level, say=console.print), cameras


def words_again(command: str, arguments: Namespace, **changes: Any) -> list[str]:
    """Return the words of a command that does what arguments say, with other values for some.

    Where its results go and what it prints is left out.
    """
    words: list[str] = parser_of(command).words_of(Namespace(**vars(arguments) | changes), *NOT_REPEATED)
    return words


def trim_into(
    folder: Path,
    arguments: Namespace,
    console: Console,
    read: Callable[[], Selected],
    *,
    command: Callable[[Any], list[str]],
    files: Sequence[Path],
    inputs: Mapping[str, Any],
    overwrite: bool = False,
    source: Path | None = None,
) -> int:
    """Trim and write the results; return the exit code, 3 where nothing was trimmed.

    Args:
        folder: for the results.
        arguments: how to trim.
        console: where to say what becomes of it.
        read: gives the rough objects; called once the folder for the results can be used.
        command: gives the words of the command that makes the same trim, for an up vector.
        files: files, and folders of masks, that are read, and that results may not replace.
        inputs: files, and what else the report says of what the trim is made from.
        overwrite: replace earlier results.
        source: the file that the results are made of, for the manifest.

    Raises:
        InputError: something that the user gave cannot be used; nothing has been written then.
    """
    start, suffix, placing = time.perf_counter(), suffix_for(arguments), placing_of(arguments)
    names = (*result_files(suffix, html=arguments.html), MARKS, *placing.patterns(suffix))
    opened = atomic_folder(folder, RESULTS, names=names, inputs=files, source=source, overwrite=overwrite)
    with opened as part, progress_over_stages(console) as stage:
        stage("read")
        scene, cameras, objects, up, excluded = read()
        one = objects.get(THE_OBJECT) if isinstance(objects, Mapping) else None
        marks = one.marks if isinstance(one, Selection) else None
        clicked = marks is not None and all(isinstance(mark, Click) for mark in marks.marks)
        if isinstance(one, Selection) and source and not clicked:  # a click means what is seen there, also if it is all
            refuse_whole_scene(one.mask, source, str(arguments.scene))
        seconds = {"read": time.perf_counter() - start}
        config = config_of(arguments)
        if up is not None and config.up is None:  # neither the user nor cameras tell it
            config = replace(config, up=up.for_trims())
        result = _trim(arguments, config, scene, cameras, objects, excluded, stage, console)
        stage("write")
        named = {name: str(value) if isinstance(value, Path) else value for name, value in inputs.items()}
        report = describe(result, named, seconds, suffix) | {"command": command(config.up)}
        if marks is not None:
            write_marks(marks, part / MARKS)
        background = arguments.write_background
        write_trim(result, report, part, suffix, background=background, html=arguments.html)
        placed = placing.write(result, part, suffix, background=background) if placing.wished else []
        said = [placing.sentence(placed, result.objects[0].up)] if placing.wished else []
        own = arguments.scene.name
        same = arguments.format is None or formats.is_named(own, suffix)
        said.append(formats.losses(scene, suffix, suffix if same else Path(own).suffix.lower()))
    titles = [title_of(entry["name"]) for entry in report["objects"]]
    for title, sentence in zip([*titles, "background"], sentences(report), strict=True):
        console.print(f"{title}: {sentence}")
    written = [entry["file"] for entry in report["objects"] if entry["file"]]
    written = written if len(written) <= _LISTED else [f"{written[0]} to {written[-1]}"]
    written += [f"background{suffix}"] if background and report["counts"]["background"] else []
    written.append(PAGE if arguments.html else PICTURE)
    console.print(f"{', '.join(written)} and the rest are in {folder}. {time.perf_counter() - start:.1f} s.")
    for sentence in filter(None, said):
        console.print(sentence)
    print_warnings(report)
    print_json(arguments, report, (folder, RESULTS))
    return NOTHING_TRIMMED if all(entry["refused"] for entry in report["objects"]) else 0


def _trim(
    arguments: Namespace,
    config: TrimConfig,
    scene: Gaussians,
    cameras: CameraSet | None,
    objects: Any,
    excluded: BoolArray | None,
    stage: Callable[[str], None],
    console: Console,
) -> TrimResult:
    announce_compiling(console)
    folder, sam, paper = getattr(arguments, "own_masks", None), arguments.sam, arguments.preset == "paper"
    masks = None if folder is None else read_masks(folder, cameras)
    labels = isinstance(objects, np.ndarray)
    number = len(np.unique(objects[objects > 0])) if labels else len(objects)
    if number > 1 and (sam is not None or paper):
        raise InputError("--sam and --preset paper are for one object; trim the objects one by one.")
    if masks is None and number == 1:
        selection = objects > 0 if labels else next(iter(objects.values()))
        masks = draw_masks(
            scene, selection, sam=sam, paper=paper, progress=stage, config=config, cameras=cameras, excluded=excluded
        )
    return trim_objects(scene, objects, config=config, masks=masks, cameras=cameras, excluded=excluded, progress=stage)
