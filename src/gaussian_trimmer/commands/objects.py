"""`gaussian-trimmer objects`: every object of a scene, without a click."""

from __future__ import annotations

import re
import shlex
import time
from argparse import Namespace
from dataclasses import fields
from pathlib import Path

from rich.console import Console

from gaussian_trimmer.commands.arguments import add_scene, add_trimming, config_of
from gaussian_trimmer.commands.console import console_of, in_lengths, print_json, print_up, progress_over_stages
from gaussian_trimmer.commands.manifest import FOUND_OBJECTS
from gaussian_trimmer.commands.trim_run import Request, add_results, read_scene, scene_name, trim_into, words_again
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import FindConfig, FoundObjects, chosen_objects
from gaussian_trimmer.finding.saving import FOUND_FILES, write_found
from gaussian_trimmer.io.folders import atomic_folder, is_made_of
from gaussian_trimmer.io.writing import safe_file_name, write_table
from gaussian_trimmer.parser import PROGRAM, Parser
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

_KIND = "objects"
_MOST_LISTED = 40


ABOUT = """Find every object of a scene: what stands on its surfaces, hangs from them or leans against them.

Writes objects.npy with a number for each Gaussian, 0 for the rest; objects.csv with place, size, colour, how sure and
why; index.html with a picture of each, on which to choose, merge, split and name, and which gives the command to go on;
and batch.csv, from which 'batch' trims them. What the program is not sure of comes last, and is trimmed only if it is
asked for."""
EXAMPLES = (
    "gaussian-trimmer objects scene.ply --cameras sparse/0",
    "gaussian-trimmer objects scene.ply --cameras sparse/0 --trim cut_out",
    "gaussian-trimmer objects scene.ply --keep 1 2 5 --merge 2+5 --names 1=mug --trim some",
)


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run, EXAMPLES)
    add_scene(parser)
    parser.add_fields("what counts as an object", FindConfig)
    group = parser.add_argument_group("choose what to trim")
    group.add_argument("--keep", kind=tuple[int, ...], metavar="ID ...", help="These; without it, all that are sure")
    group.add_argument("--merge", kind=tuple[str, ...], metavar="ID+ID ...", help="Objects that are one, such as 3+4")
    split = "Objects that are several; each falls apart into its main parts"
    group.add_argument("--split-objects", kind=tuple[int, ...], metavar="ID ...", help=split)
    names = "What to call objects, such as 1=mug"
    group.add_argument("--names", kind=tuple[str, ...], metavar="ID=NAME ...", help=names)
    group = add_results(parser, "DIR", "Folder for labels, table and page (default: found/SCENE)")
    trim = "Also trim the objects, and write them and one scene without them to this folder"
    group.add_argument("--trim", kind=Path, metavar="DIR", help=trim)
    add_trimming(parser, rare=True)


def run(arguments: Namespace) -> int:
    """Find the objects and write them, then trim them if asked to; return the exit code, 3 where nothing was trimmed.

    Raises:
        InputError: something that the user gave cannot be used.
    """
    console, scene_file = console_of(arguments), arguments.scene
    names, merge = _named(arguments.names), [_group(text) for text in arguments.merge]
    folder = arguments.output or Path("found") / scene_name(scene_file)
    edited = arguments.merge or arguments.split_objects or arguments.names
    if arguments.trim is None and (arguments.keep or arguments.merge or arguments.split_objects):
        raise InputError("--keep, --merge and --split-objects say what to trim; add --trim DIR.")
    overwrite, start = arguments.overwrite or is_made_of(folder, scene_file), time.perf_counter()
    found_files = atomic_folder(
        folder, _KIND, names=FOUND_FILES, inputs=[scene_file], source=scene_file, overwrite=overwrite
    )
    nothing, trim = (
        {"keep": (), "merge": (), "split_objects": (), "names": ()},
        Path("trimmed") / scene_name(scene_file),
    )
    again = [PROGRAM, *words_again("objects", arguments, **nothing, trim=trim)]
    again += ["--output", str(arguments.output)] if arguments.output else []
    with found_files as part, progress_over_stages(console) as stage:
        stage("read")
        scene, cameras = read_scene(arguments, console)
        up = find_up(scene, cameras, arguments.up)
        print_up(console, up)
        config = FindConfig(**{field.name: getattr(arguments, field.name) for field in fields(FindConfig)})
        found = find_objects(scene, cameras=cameras, up=up, config=config, progress=stage)
        stage("write")
        document = write_found(found, part, command=again, names=names)
        if sure := [str(one.id) for one in found if one.sure and one.kind == "object"]:
            write_table([_batch_row(arguments, sure, folder, up)], part / FOUND_OBJECTS)
    _print_found(console, found, names, folder)
    console.print(
        f"{folder}: {sum(one.sure for one in found)} objects, and "
        f"{sum(not one.sure for one in found)} that are unsure; time {time.perf_counter() - start:.1f} s"
    )
    if arguments.trim is None:
        now = shlex.join(again)
        now = f"To trim all that are sure: {now}" if sure else f"To trim some that are not: {now} --keep ID ..."
        console.print(f"To choose: open {folder / 'index.html'} in a browser. {now}")
        print_json(arguments, document, folder)
        return 0
    keep = arguments.keep or None
    chosen = chosen_objects(found, keep=keep, merge=merge, split=arguments.split_objects, names=names)
    numbered = all(name.isdigit() for name in chosen)  # then objects keep their numbers
    objects = {int(name) if numbered else name: rows for name, rows in chosen.items()}
    labels, known_up = None if edited else folder / "objects.npy", config_of(arguments).up or up.for_trims()
    words = words_again("objects", arguments)  # what was merged, split or named is in no file
    if labels is not None:
        words = words_again("trim", arguments, labels=labels, objects=tuple(objects), up=known_up)
    inputs = {"scene": scene_file, "labels": labels, "cameras": arguments.cameras}
    request = Request(scene, cameras, objects, words, inputs, up=up)
    code = trim_into(arguments.trim, arguments, console, lambda: request, files=[scene_file])
    rest = arguments.trim / "background.ply"
    if code == 0 and rest.exists():
        look = words_again("objects", arguments, **nothing, scene=rest, trim=None, level=None, up=known_up)
        console.print(f"To find what is left of them: {shlex.join([PROGRAM, *look])}")
    return code


def _batch_row(arguments: Namespace, numbers: list[str], folder: Path, up: UpVector) -> dict[str, str]:
    """Return the row of a manifest that trims these objects one by one, named as the folder."""
    cameras = arguments.cameras
    level = [] if arguments.level is None else ["--level", str(arguments.level)]
    return {
        "scene": str(arguments.scene.absolute()),
        "labels": "objects.npy",
        "objects": " ".join(numbers),
        "name": safe_file_name(folder.absolute().name),
        "cameras": str(cameras.absolute()) if cameras else "",
        "up": " ".join(map(repr, up.for_trims() or ())),
        "options": shlex.join([*level, *(["--trust-paths"] if arguments.trust_paths else [])]),
    }


def _print_found(console: Console, found: FoundObjects, names: dict[int, str], folder: Path) -> None:
    """List what is sure or, if nothing is, all; and say where the rest is."""
    listed = [one for one in found if one.sure] or list(found)
    for one in listed[:_MOST_LISTED]:
        called = f" {names[one.id]}" if one.id in names else ""
        console.print(f"object {one.id}{called}: {one.gaussians:,} Gaussians, {in_lengths(one.size)}, {one.why}")
    rest, sure = len(found) - min(len(listed), _MOST_LISTED), sum(one.sure for one in found)
    if rest:
        more = [f"{_numbers(_MOST_LISTED + 1, sure)} sure, too."] if sure > _MOST_LISTED else []
        more += [f"{_numbers(sure + 1, len(found))} not sure."] if sure < len(found) else []
        console.print(" ".join([*more, f"{folder / 'objects.csv'} lists all, plan.png has their numbers."]))
    if not found.up.is_sure:
        direction = " ".join(f"{value + 0.0:.3f}" for value in found.up.direction)
        console.print(f"Nothing is sure while up is a guess; if it is right, say so: --up {direction}")


def _numbers(first: int, last: int) -> str:
    return f"Object {first} is" if first == last else f"Objects {first} to {last} are"


def _named(texts: tuple[str, ...]) -> dict[int, str]:
    names = {}
    for text in texts:
        number, _, name = text.partition("=")
        if not number.isdigit() or not name:
            raise InputError(f"'{text}' names no object; write its number and what to call it, such as 1=mug.")
        names[int(number)] = name
    return names


def _group(text: str) -> list[int]:
    if not re.fullmatch(r"\d+(\+\d+)+", text):
        raise InputError(f"'{text}' merges nothing; write the numbers of the objects, such as 3+4.")
    return [int(number) for number in text.split("+")]
