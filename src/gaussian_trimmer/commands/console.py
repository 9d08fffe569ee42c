"""What the commands show on the terminal: a progress bar over the stages, and a summary."""

from __future__ import annotations

import json
import logging
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.manifest import earlier_results
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
_PROGRAM = "gaussian-trimmer"
_COMPILING = "Compiling kernels, once per installation: about 10 seconds."
_COMPILING_AGAIN = (
    "Compiling kernels: about 10 seconds. They cannot be kept, since no folder for them is writable; "
    "set NUMBA_CACHE_DIR to one that is."
)


@dataclass(frozen=True)
class PrintOptions:
    """What is printed on standard output."""

    quiet: bool = False
    """Print nothing but errors."""
    json: bool = False
    """Print one JSON document on standard output, and nothing else there: what was made, and where it is."""

    def console(self, log_level: str | None = None) -> Console:
        """Return what to print to."""
        return open_console(quiet=self.quiet or self.json, log_level=log_level)

    def print_json(self, document: Mapping[str, Any], results: tuple[Path, str] | None = None) -> None:
        """Print a JSON document if it is asked for, with the files of `results`: a folder and its manifest's kind."""
        if not self.json:
            return
        if results is not None:
            document = {**document, "folder": str(results[0]), "files": earlier_results(*results)}
        print(json.dumps(document, allow_nan=False))


def open_console(*, quiet: bool, log_level: str | None = None) -> Console:
    """The terminal, or standard output. Errors go elsewhere, and so does the log, which begins if it has a level."""
    if log_level is not None:
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        LOG.handlers = [handler]
        LOG.setLevel(log_level.upper())
    return _PlainConsole(quiet=quiet, highlight=False, markup=False, soft_wrap=True)


class _PlainConsole(Console):
    """Prints text without the escape sequences that names of files may have."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As `Console.print`; text keeps its line ends alone."""
        plain = ("\n".join(map(printable, text.split("\n"))) if isinstance(text, str) else text for text in objects)
        super().print(*plain, **options)


@contextmanager
def progress_over_stages(console: Console) -> Iterator[Callable[[str], None]]:
    """Give a function to call with the name of each stage as it begins; nothing is shown outside a terminal."""
    bar = Progress(
        SpinnerColumn("dots" if console.encoding.startswith("utf") else "line"),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=console.quiet or not console.is_terminal,
    )
    with bar:
        task = bar.add_task("", total=_PROGRESS_STEPS)

        def show(stage: str) -> None:
            name, _, part = stage.partition(" ")  # a part of a stage that takes long is no step of its own
            bar.update(task, description=f"{_STAGES.get(name, name)} {part}".rstrip(), advance=0 if part else 1)

        yield show


def print_summary(console: Console, report: Mapping[str, Any], seconds: float) -> None:
    """Counts, views, up vector and time of a finished trim, from its report."""
    counts = report["counts"]
    accepted = sum(view["accepted"] for view in report["views"])
    rows = [("selected", f"{counts['selected']:,} of {counts['scene']:,} Gaussians; of these:")]
    rows.append(("  kept", f"{counts['kept']:,}"))
    if counts["cut"]:
        split = f", {counts['split']:,} of them split with the background" if counts["split"] else ""
        rows.append(("  cut", f"{counts['cut']:,} at the outline{split}"))
    floaters = f", {counts['floaters']:,} of them far away" if counts["floaters"] else ""
    rows.append(("  removed", f"{counts['removed']:,}{floaters}"))
    if report["shrunk_side"]:
        rows.append(("  smaller by", report["shrunk_side"]))
    if counts["discarded"]:
        rows.append(("  discarded", f"{counts['discarded']:,}, in neither file"))
    rows.append(("added", f"{counts['added']:,} that the selection had missed"))
    if counts["fitted"]:
        rows.append(("fitted", f"{counts['fitted']:,} at the outline"))
    elif report["not_fitted"]:
        rows.append(("not fitted", report["not_fitted"]))
    if counts["hidden"]:
        rows.append(("background", f"{counts['hidden']:,} hidden Gaussians discarded"))
    if counts["filled"]:
        relit = f"; shadow removed from {counts['relit']:,}" if counts["relit"] else ""
        rows.append(("filled in", f"{counts['filled']:,} new Gaussians where the object stood{relit}"))
    elif report["not_filled"]:
        rows.append(("not filled in", report["not_filled"]))
    judged = all(view["judged"] for view in report["views"])
    own_masks = "; their masks follow the selection, so none could be rejected"
    rows.append(("views", f"{accepted} of {len(report['views'])} used{'' if judged else own_masks}"))
    rows.append(("sides", report["checked"]["sentence"]))
    rows.append(("up", up_text(**report["up"])))
    rows.append(("time", f"{seconds:.1f} s"))
    column = 2 + max(len(name) for name, _ in rows)
    width = max(console.width, 2 * column) if console.is_terminal else sys.maxsize  # a file has no edge
    for name, value in rows:
        further = " " * column
        console.print(textwrap.fill(value, width, initial_indent=name.ljust(column), subsequent_indent=further))


def print_up(console: Console, up: UpVector) -> None:
    """The up vector, where it comes from, and a warning where it is little more than a guess."""
    console.print(f"up: {up_text(**vars(up))}")
    if doubt := up.doubt():
        console.print(doubt)


def in_lengths(size: Float64Array) -> str:
    """Return the length, width and height of something, (3,), as a line of text has them."""
    return " x ".join(f"{value:.2g}" for value in size)


def print_refusal(report: Mapping[str, Any]) -> None:
    """Say on standard error, also to those who asked for quiet, that nothing was trimmed and why, if that is so."""
    if not report["refused"]:
        return
    reason = printable(report["refused"])
    _complain(f"Not trimmed. {reason[:1].upper()}{reason[1:]}. The selection was written unchanged.")


def print_warnings(entries: Sequence[Mapping[str, Any]]) -> None:
    """Say on standard error, also to those who asked for quiet, what may be wrong, and with which of several objects.

    That a side is smaller, as it mostly should be, is in the summary.
    """
    from gaussian_trimmer.output.report import alerts  # late: conversions need no trimmer
    from gaussian_trimmer.trimming.result import title_of

    found: dict[str, list[str]] = {}
    for entry in entries:
        for sentence in alerts(entry["warnings"], entry["shrunk_side"]):
            found.setdefault(sentence, []).append(title_of(entry["name"]))
    for sentence, titles in found.items():
        whose = "" if len(titles) == len(entries) else f"{', '.join(titles)}: "
        _complain(printable(whose + sentence))


def _complain(sentence: str) -> None:
    print(f"{_PROGRAM}: {sentence}", file=sys.stderr)


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
    from gaussian_trimmer.geometry.compiling import CACHE
    from gaussian_trimmer.rendering.numba_kernels import blend_tiles

    if not CACHE:
        console.print(_COMPILING_AGAIN)
    elif not any(Path(str(blend_tiles.stats.cache_path)).glob("numba_kernels.blend_tiles-*.nbi")):
        from gaussian_trimmer.rendering.compiling_ahead import start_compiling

        console.print(_COMPILING)
        start_compiling()
