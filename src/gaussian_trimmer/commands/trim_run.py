"""What `trim`, `select --trim` and `objects --trim` have in common: read a scene, trim in it, write and say results."""

from __future__ import annotations

import re
import time
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
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
from gaussian_trimmer.io.reading import is_folder
from gaussian_trimmer.masks.mask_files import read_masks
from gaussian_trimmer.masks.sam import draw_masks
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import PAGE, PICTURE, RESULTS, result_files, write_trim
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.selecting.marks import Click, Marks, write_marks
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.clock import Progress
from gaussian_trimmer.trimming.result import THE_OBJECT, TrimResult, title_of
from gaussian_trimmer.trimming.trim import trim_objects
from gaussian_trimmer.trimming.up_vector import UpVector

NOTHING_TRIMMED = 3
"""Exit code where the inputs could be read, but the selections were written unchanged."""
MARKS = "selection.json"
"""Name of the file of marks among the results."""
NOT_REPEATED = ("output", "overwrite", "quiet", "json", "log_level", "config_file")
_LISTED = 4
_NAMES_OF_ALL = re.compile(r"scene|splats?|point_cloud|iteration_\d+|meta|lod-meta|output", re.IGNORECASE)
"""What trainings and converters call every scene's file, and the folders around it."""


@dataclass(frozen=True, eq=False)
class Request:
    """What is to be trimmed, after it was read."""

    scene: Gaussians
    cameras: CameraSet | None
    objects: Any
    """As `trim_objects` takes them."""
    command: Sequence[str]
    """Words of the command that makes the same trim."""
    inputs: Mapping[str, Any]
    """What the report says of what the trim is made from."""
    marks: Marks | None = None
    """The marks that selected the one object, if that is what did."""
    up: UpVector | None = None
    """The up vector of the whole scene; if it is sure, no object searches for its own."""
    excluded: BoolArray | None = None
    """Which Gaussians join no object, (N,)."""


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
    read: Callable[[], Request],
    *,
    files: Sequence[Path],
    source: Path | None = None,
) -> int:
    """Trim and write the results; return the exit code, 3 where nothing was trimmed.

    Args:
        folder: for the results.
        arguments: how to trim.
        console: where to say what becomes of it.
        read: reads what is to be trimmed; called once the folder for the results can be used.
        files: files, and folders of masks, that are read, and that results may not replace.
        source: the file that holds the one object, for the manifest.

    Raises:
        InputError: something that the user gave cannot be used; nothing has been written then.
    """
    start = time.perf_counter()
    if arguments.sam is not None and not is_folder(arguments.sam):
        raise InputError(f"There is no folder '{arguments.sam}'; --sam names that of a SAM or SAM 2.")
    with _begin(folder, arguments, files, source) as part, progress_over_stages(console) as stage:
        stage("read")
        request = read()
        clicked = request.marks is not None and all(isinstance(mark, Click) for mark in request.marks.marks)
        if source is not None and not clicked:  # a click means what is seen there, also if it is all
            refuse_whole_scene(request.objects[THE_OBJECT].mask, source, str(arguments.scene))
        seconds = {"read": time.perf_counter() - start}
        announce_compiling(console)
        result = _trim(request, arguments, stage)
        named = {name: str(value) if isinstance(value, Path) else value for name, value in request.inputs.items()}
        report = describe(result, named, seconds, suffix_for(arguments)) | {"command": request.command}
        stage("write")
        notes = _write(result, report, request, arguments, part)
    written = _written(report, arguments)
    _say(report, [f"{written} are in {folder}. {time.perf_counter() - start:.1f} s.", *notes], console)
    print_json(arguments, report, folder)
    return NOTHING_TRIMMED if all(entry["refused"] for entry in report["objects"]) else 0


def _begin(
    folder: Path, arguments: Namespace, files: Sequence[Path], source: Path | None
) -> AbstractContextManager[Path]:
    """Return the folder to write to, once it is sure that the results can take their places."""
    suffix = suffix_for(arguments)
    names = (*result_files(suffix, html=arguments.html), MARKS, *placing_of(arguments).patterns(suffix))
    return atomic_folder(folder, RESULTS, names=names, inputs=files, source=source, overwrite=arguments.overwrite)


def _trim(request: Request, arguments: Namespace, stage: Progress) -> TrimResult:
    """Trim, with masks from files or of a model if they were asked for."""
    scene, objects, config = request.scene, request.objects, config_of(arguments)
    up = request.up if request.up is not None and request.up.for_trims() and config.up is None else None
    given: dict[str, Any] = {"config": config, "cameras": request.cameras, "excluded": request.excluded, "up": up}
    folder, sam, paper = getattr(arguments, "own_masks", None), arguments.sam, arguments.preset == "paper"
    masks = None if folder is None else read_masks(folder, request.cameras)
    labels = isinstance(objects, np.ndarray)
    number = len(np.unique(objects[objects > 0])) if labels else len(objects)
    if number > 1 and (sam is not None or paper):
        raise InputError("--sam and --preset paper are for one object; trim the objects one by one.")
    if masks is None and number == 1:
        selection = objects > 0 if labels else next(iter(objects.values()))
        masks = draw_masks(scene, selection, sam=sam, paper=paper, progress=stage, **given)
    return trim_objects(scene, objects, masks=masks, progress=stage, **given)


def _write(
    result: TrimResult, report: Mapping[str, Any], request: Request, arguments: Namespace, folder: Path
) -> list[str]:
    """Write the results to a folder; return sentences about the files."""
    suffix, placing, background = suffix_for(arguments), placing_of(arguments), arguments.write_background
    if request.marks is not None:
        write_marks(request.marks, folder / MARKS)
    write_trim(result, report, folder, suffix, background=background, html=arguments.html)
    placed = placing.write(result, folder, suffix, background=background) if placing.wished else []
    notes = [placing.sentence(placed, result.objects[0].up)] if placing.wished else []
    own = arguments.scene.name
    same = arguments.format is None or formats.is_named(own, suffix)
    notes.append(formats.losses(result.scene, suffix, suffix if same else Path(own).suffix.lower()))
    return notes


def _written(report: Mapping[str, Any], arguments: Namespace) -> str:
    """Return the names of the most important files, and that there are others."""
    names = [entry["file"] for entry in report["objects"] if entry["file"]]
    names = names if len(names) <= _LISTED else [f"{names[0]} to {names[-1]}"]
    counts = report["counts"]
    if arguments.write_background and counts["background"] and counts["refused"] < counts["objects"]:
        names.append(f"background{suffix_for(arguments)}")
    return f"{', '.join([*names, PAGE if arguments.html else PICTURE])} and the rest"


def _say(report: Mapping[str, Any], notes: Sequence[str], console: Console) -> None:
    """Say what became of each object and of the background, then some notes, then what may be wrong."""
    titles = [title_of(entry["name"]) for entry in report["objects"]]
    for title, sentence in zip([*titles, "background"], sentences(report), strict=True):
        console.print(f"{title}: {sentence}")
    for note in filter(None, notes):
        console.print(note)
    print_warnings(report)
