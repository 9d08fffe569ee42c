"""`gaussian-trimmer convert`: one splat format to another."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.commands.arguments import LEVEL, add_placing, placing_of
from gaussian_trimmer.commands.console import add_printing, console_of, print_json, print_up, refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.formats.packing import morton_order
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.parser import UP, Parser
from gaussian_trimmer.trimming.up_vector import DEFAULT_UP, find_up

ABOUT = """Convert a splat file. The endings of the names tell the formats.

A file cannot be converted into itself: what the format does not hold would be lost."""
EXAMPLES = (
    "gaussian-trimmer convert scene.ply scene.spz",
    "gaussian-trimmer convert object.ply object_unity.ply --for unity --up z",
)
_SPZ_VERSION = 3


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run, EXAMPLES)
    source = "File to read, in any splat format, or the folder of a training"
    parser.add_argument("source", kind=Path, metavar="SOURCE", help=source)
    parser.add_argument("target", kind=Path, metavar="TARGET", help="File to write")
    parser.add_argument("--level", kind=int, metavar="N", help=LEVEL)
    values = (
        "What SOURCE holds, where it cannot be told: logarithms and logits, stored, or scales and opacities, activated"
    )
    parser.add_argument("--values", kind=formats.Values, help=values)
    sort = "Write the rows in Morton order: compressed files get smaller, but selections no longer fit"
    parser.add_argument("--sort", kind=bool, help=sort)
    version = "Version of an .spz target: 3, which every reader knows, or 4, which is a little smaller"
    parser.add_argument("--spz-version", kind=Literal[3, 4], default=_SPZ_VERSION, help=version)
    add_placing(parser, "A file for this program: upright, the foot at the origin, in a format that it reads")
    parser.add_argument(
        "--up", kind=UP, help="Which way is up in SOURCE, for --for and --origin; by default as the ground"
    )
    parser.add_argument("--overwrite", kind=bool, help="Replace the target if it exists")
    add_printing(parser)


def run(arguments: Namespace) -> None:
    """Read, write, and print how large the files are.

    Raises:
        InputError: the source cannot be read, or the target is the source, exists, or cannot be written, or has no
            versions.
    """
    source, target, placing = identify(arguments.source).scene, arguments.target, placing_of(arguments)
    refuse_existing(target, inputs=[source], overwrite=arguments.overwrite)
    placing.check_target(target)
    suffix, placed = formats.target_suffix(target), dict[str, Any]()
    if arguments.up is not None and not placing.needs_up:
        raise InputError("--up is for --for and --origin; without them the axes stay.")
    if arguments.spz_version != _SPZ_VERSION and suffix != ".spz":
        raise InputError(f"'{target}' is not an .spz file; leave --spz-version out, or give it that ending.")
    console = console_of(arguments)
    gaussians = formats.read(arguments.source, level=arguments.level, values=arguments.values, say=console.print)
    gaussians = formats.without_blank(gaussians)
    notes = list(filter(None, [formats.losses(gaussians, suffix, formats.written_suffix(source))]))
    if placing.wished:
        up = _found_up(arguments, gaussians, console) if placing.needs_up else DEFAULT_UP
        place = placing.placement(gaussians, up)
        gaussians, placed = place.apply(gaussians), place.as_json()
        if place.origin.any():
            at = " ".join(f"{value:.4g}" for value in place.origin)
            notes.append(f"The origin is {at} of the scene; with --origin scene it stays.")
    if arguments.sort:
        gaussians = gaussians.select(morton_order(gaussians.means))
    formats.write(gaussians, target, **({"version": arguments.spz_version} if suffix == ".spz" else {}))
    count = len(gaussians)
    read = formats.scene_files(source, arguments.level)
    before, after = (sum(path.stat().st_size for path in paths) for paths in (read, [target]))
    console.print(f"{target}: {count:,} Gaussians, {after / 1e6:.1f} MB instead of {before / 1e6:.1f} MB")
    for sentence in notes:
        console.print(sentence)
    said = {"gaussians": count, "notes": notes, **placed}
    print_json(arguments, {"file": str(target), "bytes": after, "bytes_of_source": before, **said})


def _found_up(arguments: Namespace, gaussians: Gaussians, console: Console) -> Float64Array:
    """Return the up vector that is given, or else that of the ground; it is printed.

    Raises:
        InputError: nothing tells which way is up, and a file would be called upright by a guess.
    """
    check_magnitudes(gaussians)
    up = find_up(gaussians, given=arguments.up)
    if up.confidence == 0:
        raise InputError(f"Nothing in '{arguments.source}' tells which way is up; give --up, such as --up -y.")
    print_up(console, up)
    return up.direction
