"""What the commands show on the terminal: a progress bar over the stages, and a summary."""

from __future__ import annotations

import json
import logging
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.folders import MANIFEST, listed_sizes
from gaussian_trimmer.parser import PROGRAM
from gaussian_trimmer.trimming.clock import LOG
from gaussian_trimmer.trimming.up_vector import UpVector, up_text

_STAGES = {
    "read": "reading the files",
    "look": "looking at the scene",
    "surfaces": "finding its surfaces",
    "regions": "finding its objects",
    "plan": "planning the cameras",
    "render": "rendering the views",
    "correct": "correcting the labels",
    "segment": "segmenting the views",
    "weigh": "weighing the evidence",
    "prune": "pruning",
    "split": "splitting at the boundary",
    "remove": "making the scene without the object",
    "assemble": "putting the parts together",
    "refine": "fitting the outline",
    "write": "writing files and pictures",
}
_PROGRESS_STEPS = len(_STAGES) + 1
"""Views are rendered twice: before the labels are corrected, and after."""
_COMPILING = "Compiling kernels, once per installation: about 10 seconds."
_COMPILING_AGAIN = (
    "Compiling kernels: about 10 seconds. They cannot be kept, since no folder for them is writable; "
    "set NUMBA_CACHE_DIR to one that is."
)


def add_printing(group: Any, *, log: bool = False) -> None:
    """Add what is printed to a group of arguments."""
    group.add_argument("--quiet", kind=bool, help="Print nothing but errors")
    group.add_argument("--json", kind=bool, help="Print one JSON document instead: what was made, and where it is")
    if log:
        levels = Literal["debug", "info", "warning", "error"]
        group.add_argument("--log-level", kind=levels, rare=True, help="Log each stage on standard error")


def console_of(arguments: Namespace) -> Console:
    """Return what to print to. Errors go elsewhere, and so does the log, which begins if it has a level."""
    if getattr(arguments, "log_level", None) is not None:
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        LOG.handlers = [handler]
        LOG.setLevel(arguments.log_level.upper())
    return open_console(quiet=arguments.quiet or arguments.json)


def open_console(*, quiet: bool) -> Console:
    """Return the terminal, or standard output."""
    return _PlainConsole(quiet=quiet, highlight=False, markup=False, soft_wrap=True)


def print_json(arguments: Namespace, document: Mapping[str, Any], results: Path | None = None) -> None:
    """Print a JSON document if it is asked for, with the files of a folder of results."""
    if not arguments.json:
        return
    if results is not None:
        document = {**document, "folder": str(results), "files": [MANIFEST, *listed_sizes(results)]}
    print(json.dumps(document, allow_nan=False))


class _PlainConsole(Console):
    """Prints text without the escape sequences that names of files may have."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As `Console.print`; text keeps its line ends alone."""
        plain = ("\n".join(map(printable, text.split("\n"))) if isinstance(text, str) else text for text in objects)
        super().print(*plain, **options)


@contextmanager
def progress_over_stages(console: Console) -> Iterator[Callable[[str], None]]:
    """Give a function to call with the name of each stage as it begins; nothing is shown outside a terminal."""
    if console.quiet or not console.is_terminal:  # some versions of rich end a disabled bar with a line
        yield lambda stage: None
        return
    bar = Progress(
        SpinnerColumn("dots" if console.encoding.startswith("utf") else "line"),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
    )
    with bar:
        task = bar.add_task("", total=_PROGRESS_STEPS)

        def show(stage: str) -> None:
            name, _, part = stage.partition(" ")  # a part of a stage that takes long is no step of its own
            bar.update(task, description=f"{_STAGES.get(name, name)} {part}".rstrip(), advance=0 if part else 1)

        yield show


def print_up(console: Console, up: UpVector) -> None:
    """The up vector, where it comes from, and a warning where it is little more than a guess."""
    console.print(f"up: {up_text(**vars(up))}")
    if doubt := up.doubt():
        console.print(doubt)


def in_lengths(size: Float64Array) -> str:
    """Return the length, width and height of something, (3,), as a line of text has them."""
    return " x ".join(f"{value:.2g}" for value in size)


def print_warnings(report: Mapping[str, Any]) -> None:
    """Say on standard error, also to those who asked for quiet, what may be wrong, and with which of several objects.

    First comes what was not trimmed at all, and why.
    """
    from gaussian_trimmer.trimming.result import title_of  # late: conversions need no trimmer

    found, alone = dict[str, list[str]](), ""
    if all(entry["refused"] for entry in report["objects"]):
        alone = ", and no scene without it"
    for entry in sorted(report["objects"], key=lambda entry: not entry["refused"]):
        why = entry["refused"] or ""
        refused = f"Not trimmed. {why[:1].upper()}{why[1:].rstrip('.')}. The selection was written unchanged{alone}."
        for sentence in [*([refused] if why else []), *entry["warnings"]]:
            found.setdefault(sentence, []).append(title_of(entry["name"]))
    for sentence, titles in found.items():
        whose = "" if len(titles) == len(report["objects"]) else f"{', '.join(titles)}: "
        print(f"{PROGRAM}: {printable(whose + sentence)}", file=sys.stderr)


def refuse_existing(path: Path, *, inputs: Iterable[Path] = (), overwrite: bool) -> None:
    """Keep a file from being replaced unasked, and an input of this run from being replaced at all.

    Raises:
        InputError: the file exists and may not be overwritten, or is one of the inputs, or its folder is missing.
    """
    if not path.parent.is_dir():
        raise InputError(f"There is no folder '{path.parent}' to write '{path.name}' to; make it first.")
    if any(path.exists() and given.exists() and path.samefile(given) for given in inputs):
        raise InputError(f"'{path}' is an input of this run, which would be lost; choose another name.")
    if os.path.lexists(path) and not overwrite:
        raise InputError(f"'{path}' exists; choose another name, or replace it with --overwrite.")


def announce_compiling(console: Console) -> None:
    """Say that kernels are compiled first, and begin with it, unless an earlier run has left them on disk."""
    from gaussian_trimmer.parallel import keeps_kernels
    from gaussian_trimmer.rendering.numba_kernels import blend_tiles

    if not keeps_kernels():
        console.print(_COMPILING_AGAIN)
    elif not any(Path(str(blend_tiles.stats.cache_path)).glob("numba_kernels.blend_tiles-*.nbi")):
        from gaussian_trimmer.rendering.gradients import start_compiling

        console.print(_COMPILING)
        start_compiling()
