"""`gaussian-trimmer trim`: a scene and rough selections in, sharp objects and a clean background out; and `demo`."""

from __future__ import annotations

import os
import shlex
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from rich.console import Console

from gaussian_trimmer import sample
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands import parser_of
from gaussian_trimmer.commands.arguments import (
    add_marks,
    add_scene,
    add_trimming,
    mark_files,
    marks_of,
    selection_options_of,
    views_of,
)
from gaussian_trimmer.commands.console import console_of, open_console
from gaussian_trimmer.commands.trim_run import (
    NOT_REPEATED,
    Request,
    add_results,
    read_scene,
    scene_name,
    trim_into,
    words_again,
)
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.parser import PROGRAM, Parser
from gaussian_trimmer.selecting.lifting import lift_folder
from gaussian_trimmer.selecting.select import with_query_row
from gaussian_trimmer.selecting.selection import Selection, read_selection, read_selection_result
from gaussian_trimmer.selection_files import load_objects
from gaussian_trimmer.selection_files.kinds import is_trimmed
from gaussian_trimmer.selection_files.selection_file import open_selection
from gaussian_trimmer.trimming.result import THE_OBJECT

ABOUT = """Sharpen a rough selection of one object, or of several: write objects, the scene without them, and a report.

Without SELECTION, and without anything else that says what to select, the file is taken to hold the object alone;
a black fringe in the air around it is left out."""
ABOUT_DEMO = "Trim an object of the sample scene that comes with the program, and say where the results are."
ReadScene = Callable[..., Gaussians]
"""Reads a scene as `formats.read` does."""
EXAMPLES = (
    "gaussian-trimmer trim scene.ply selection.npy --cameras sparse/0",
    "gaussian-trimmer trim scene.ply cut.ply --up z --output cup --html",
    "gaussian-trimmer trim scene.ply --labels labels.npy --cameras transforms.json",
    "gaussian-trimmer trim object.ply --up -y --for unreal",
    "gaussian-trimmer trim --config cup/report.json --output again",
)


def add_arguments(parser: Parser) -> None:
    """Say what `trim`, or `demo`, takes."""
    if parser.command == "demo":
        _add_demo(parser)
        return
    parser.describe(ABOUT, run, EXAMPLES)
    add_scene(parser, nargs="?")  # --config may name it
    selection = (
        "Which Gaussians roughly are the object: a mask, labels, row numbers, a PLY cut out of the scene, what a "
    )
    selection += "method saved, or marks saved as .json"
    parser.add_argument("selection", kind=Path, nargs="?", metavar="SELECTION", help=selection)
    group = parser.add_argument_group("several objects")
    labels = "Trim several objects at once: a file with an id for each Gaussian, or a folder of masks that hold ids"
    group.add_argument("--labels", kind=Path, metavar="FILE", help=labels)
    which = "Which objects of --labels; by default all whose ids are above zero"
    group.add_argument("--objects", kind=tuple[int, ...], metavar="ID ...", help=which)
    others = "Selections of other objects, such as labels.npz of an earlier trim, that stay out of this one"
    group.add_argument("--exclude", kind=tuple[Path, ...], metavar="FILE ...", help=others)
    add_marks(parser, rare=True)
    add_trimming(parser)
    group = parser.add_argument_group("masks of pictures")
    masks = "Folder of masks of the object, named like the cameras' pictures, in place of virtual views; or a pattern "
    masks += "such as 'out/*/chosen_cup.png', in which * stands for the name or its number"
    group.add_argument("--masks", dest="own_masks", kind=Path, metavar="DIR", help=masks)
    group = add_results(parser, "DIR", "Folder for the results (default: trimmed/SCENE-SELECTION)")
    again = "Trim as an earlier run did, by its report.json; options beside it are added"
    group.add_argument("--config", dest="config_file", kind=Path, metavar="FILE", help=again)


def run(arguments: Namespace, read: ReadScene | None = None, note: Mapping[str, Any] = MappingProxyType({})) -> int:
    """Trim and write the results; return the exit code, 3 where nothing was trimmed.

    Args:
        arguments: of the command.
        read: reads the scene, in place of `formats.read`.
        note: what the report says among the inputs beside them.

    Raises:
        InputError: something that the user gave cannot be used; nothing has been written then.
    """
    if arguments.config_file is not None:
        arguments = _as_before(arguments)
    if arguments.scene is None:
        raise InputError(f"'trim' needs SCENE; see {PROGRAM} trim --help.")
    console, given, folder = console_of(arguments), arguments.scene, folder_of(arguments)
    arguments.scene = scene_of(arguments)
    check(arguments)
    inputs = {name: getattr(arguments, name) for name in ("scene", "selection", "labels", "cameras")} | dict(note)
    words = words_again("trim", arguments, scene=given)
    wanted = partial(_read, arguments, console, read, words, inputs)
    return trim_into(folder, arguments, console, wanted, files=list(files_of(arguments)), source=arguments.selection)


def _is_word(value: object) -> bool:
    """Return whether a command can have a value as a word: paths hold neither zeros nor halves of characters."""
    try:
        return isinstance(value, str) and b"\0" not in os.fsencode(value)
    except UnicodeEncodeError:
        return False


def _as_before(arguments: Namespace) -> Namespace:
    """Return the arguments of the run that wrote a report, to which those that are given are added.

    A selection, or labels, that are given take the place of all that said what to select.
    """
    path = arguments.config_file
    report = read_json(path)
    command = report.get("command") if isinstance(report, dict) else None
    if not isinstance(command, list) or not command or not all(map(_is_word, command)):
        raise InputError(
            f"'{path}' holds no command: it is no report.json, or one that Python, the app or an earlier release "
            "wrote; leave --config out, and give scene, selection and options."
        )
    if command[0] != "trim":
        raise InputError(f"'{clip_name(str(path))}' is of another command; repeat {PROGRAM} {shlex.join(command)}.")
    try:
        base = parser_of("trim").parse(command[1:])
    except InputError as error:
        raise InputError(f"'{path}' holds no command of this release: {error}") from error
    for name in NOT_REPEATED:  # these are no part of what was trimmed
        setattr(base, name, base.parser.get_default(name))
    if arguments.selection is not None or arguments.labels is not None:
        base.selection, base.labels, base.objects, base.in_order = None, None, (), ()
        base.set = tuple(text for text in base.set if not text.startswith("selection."))
    merged: Namespace = parser_of("trim").parse(arguments.typed, base)
    return merged


def folder_of(arguments: Namespace) -> Path:
    """Return the folder for the results."""
    if arguments.output is not None:
        return Path(arguments.output)
    given = arguments.selection or arguments.labels
    names = [scene_name(arguments.scene), *([given.name.split(".")[0]] if given else [])]
    return Path("trimmed") / "-".join(
        [*names, *map(str, arguments.objects or selection_options_of(arguments).object_id)]
    )


def scene_of(arguments: Namespace) -> Path:
    """Return the scene to read: of a folder that is given as both scene and selection, the selection's own."""
    scene: Path = arguments.scene
    return identify(scene).scene_and_selection if arguments.selection == scene else scene


def check(arguments: Namespace) -> None:
    """Refuse what is not possible, or cannot go together, before anything is read."""
    scene, selection = arguments.scene, arguments.selection
    given_last = selection is not None and identify(selection).kind in ("splats", "torch")
    if given_last and not identify(scene).may_be_scene:
        raise InputError(f"'{scene.name}' is not a splat file; the scene comes before the selection.")
    if arguments.own_masks is not None and (arguments.sam or arguments.views is not None):
        raise InputError("--masks has its own cameras and masks; leave --sam and --views out.")
    marks = marks_of(arguments)
    if arguments.labels is None:
        if arguments.objects:
            raise InputError("--objects says which objects of --labels FILE to trim; give the file, or leave it out.")
        return
    if selection is not None or marks:
        raise InputError("--labels says what to trim; leave SELECTION and marks out.")
    if arguments.own_masks is not None:
        raise InputError("--masks is for one object; give --labels a folder of masks whose pixels are ids.")


def _read(
    arguments: Namespace, console: Console, read: ReadScene | None, words: list[str], inputs: Mapping[str, Any]
) -> Request:
    """Return the scene and what is selected in it, without what --exclude names."""
    scene, cameras = read_scene(arguments, console, read)
    others = np.zeros(len(scene), np.bool_)
    for path in arguments.exclude:
        others |= _rows_of(path, scene)
    lost = "Nothing is left of {}, since --exclude takes all of it; leave a file out."
    if arguments.labels is None:
        selection = _selected(arguments, scene, cameras, console)
        mask = selection.mask & ~others
        if not mask.any():
            raise InputError(lost.format("the selection"))
        selected = {THE_OBJECT: replace(selection, mask=mask)}
        return Request(scene, cameras, selected, words, inputs, selection.marks, excluded=others)
    labels = _labelled(arguments, scene, cameras)
    left = np.where(others, 0, labels)
    for number in np.setdiff1d(labels, left):
        raise InputError(lost.format(f"object {number}"))
    return Request(scene, cameras, left, words, inputs, excluded=others)


def _selected(arguments: Namespace, scene: Gaussians, cameras: CameraSet | None, console: Console) -> Selection:
    """Return what SELECTION and marks select."""
    options = selection_options_of(arguments)
    if options.query_point is not None:
        options = with_query_row(options, scene, next(iter(views_of(arguments)), None), cameras)
    return read_selection_result(
        arguments.selection,
        scene,
        options,
        marks_of(arguments),
        cameras=cameras,
        camera_path=arguments.cameras,
        up=arguments.up,
        say=console.print,
    )


def _labelled(arguments: Namespace, scene: Gaussians, cameras: CameraSet | None) -> IntArray:
    """Return the id of each Gaussian's object by --labels, 0 for none, (N,)."""
    path, wanted = arguments.labels, arguments.objects
    if not path.is_dir():
        return load_objects(path, scene, wanted, selection_options_of(arguments))
    labels, _ = lift_folder(scene, cameras, path, ids=True)
    present = [int(number) for number in np.unique(labels) if number > 0]
    if absent := sorted(set(wanted) - set(present)):
        raise InputError(f"The masks in '{path}' show no object {absent[0]}; they show {present[:24]}.")
    return np.where(np.isin(labels, wanted or present), labels, 0)


def files_of(arguments: Namespace) -> Iterator[Path]:
    """Yield the files, and folders of masks, that are read. A folder with cameras may hold the results as well."""
    yield from (path for path in (arguments.cameras, arguments.labels) if path is not None and path.is_file())
    options = [vars(selection_options_of(arguments)), {"sam": arguments.sam, "masks": arguments.own_masks}]
    within = [value for values in options for value in values.values()]
    given = [arguments.scene, arguments.selection, *arguments.exclude, *within, *mark_files(arguments)]
    yield from (path for path in given if isinstance(path, Path))


def _rows_of(path: Path, scene: Gaussians) -> BoolArray:
    """Return which Gaussians of the scene a file for --exclude means, (N,)."""
    if path.suffix == ".npz" and is_trimmed(open_selection(path, len(scene))):
        return np.asarray(load_objects(path, scene) > 0)
    return read_selection(path, scene)


def _add_demo(parser: Parser) -> None:
    parser.describe(ABOUT_DEMO, _demo)
    output = "Folder for the results (default: trimmed/demo, where every run replaces those of the last)"
    parser.add_argument("--output", kind=Path, metavar="DIR", help=output)
    parser.add_argument("--overwrite", kind=bool, help="Replace earlier results in the output folder")
    parser.add_argument("--quiet", kind=bool, help="Print nothing but errors")


def _demo(arguments: Namespace) -> int:
    console, folder = open_console(quiet=arguments.quiet), arguments.output or Path("trimmed") / "demo"
    console.print("The sample: a toy lighthouse on a table, roughly selected, with parts of the table around its foot.")
    words = [*map(str, [sample.SCENE, sample.SELECTION, "--cameras", sample.CAMERAS]), "--html"]
    own = ["--output", str(folder), *(["--overwrite"] if arguments.overwrite or arguments.output is None else [])]
    given = parser_of("trim").parse([*words, *own, *(["--quiet"] if arguments.quiet else [])])
    code = run(given)
    console.print(f"\nLook first at {folder / 'report.html'} in a browser: before and after, and what was done.")
    console.print(f"The same by hand:\n  {shlex.join([PROGRAM, 'trim', *words])}")
    return code
