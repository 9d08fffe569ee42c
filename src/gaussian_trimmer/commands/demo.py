"""`gaussian-trimmer demo`: trims the lighthouse of the sample scene."""

from __future__ import annotations

import shlex
from argparse import Namespace
from pathlib import Path

from gaussian_trimmer import sample
from gaussian_trimmer.commands import parser_of
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.parser import PROGRAM, Parser

ABOUT = "Trim an object of the sample scene that comes with the program, and say where the results are."


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run)
    output = "Folder for the results (default: trimmed/demo, where every run replaces those of the last)"
    parser.add_argument("--output", kind=Path, metavar="DIR", help=output)
    parser.add_argument("--overwrite", kind=bool, help="Replace earlier results in the output folder")
    parser.add_argument("--quiet", kind=bool, help="Print nothing but errors")


def run(arguments: Namespace) -> int:
    """Trim and write the results; exit code and errors are those of `trim`."""
    console, folder = open_console(quiet=arguments.quiet), arguments.output or Path("trimmed") / "demo"
    console.print("The sample: a toy lighthouse on a table, roughly selected, with parts of the table around its foot.")
    words = [*map(str, [sample.SCENE, sample.SELECTION, "--cameras", sample.CAMERAS]), "--html"]
    own = ["--output", str(folder), *(["--overwrite"] if arguments.overwrite or arguments.output is None else [])]
    trim = parser_of("trim").parse([*words, *own, *(["--quiet"] if arguments.quiet else [])])
    code: int = trim.run(trim)
    console.print(
        f"\nLook first at {folder / 'report.html'} in a browser: before and after, and what was done.\n"
        f"{folder / 'before_after.png'}: selection, trimmed object and the scene without it, in one picture.\n"
        f"{folder / 'object.ply'} and {folder / 'background.ply'}: for any splat viewer.\n"
        f"{folder / 'views'}: where the outline was drawn. {folder / 'report.json'}: all numbers."
    )
    console.print(f"The same by hand:\n  {shlex.join([PROGRAM, 'trim', *words])}")
    return code
