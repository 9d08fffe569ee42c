"""`gaussian-trimmer batch`: many objects of many scenes, from manifests."""

from __future__ import annotations

import io
import re
import traceback
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, redirect_stderr, suppress
from functools import cache, lru_cache, partial
from pathlib import Path
from signal import SIGINT
from typing import Annotated, Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.commands import parser_of, trim
from gaussian_trimmer.commands.arguments import suffix_for
from gaussian_trimmer.commands.console import add_printing, console_of, print_json
from gaussian_trimmer.commands.manifest import (
    Item,
    check_names,
    checked_name,
    option_words,
    read_manifest,
)
from gaussian_trimmer.commands.pools import on_processes, on_ray
from gaussian_trimmer.errors import InputError, clip_name, printable, user_message
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.folders import is_complete, remove_leftovers
from gaussian_trimmer.io.reading import is_file, is_folder, read_json
from gaussian_trimmer.io.writing import Stopped, make_folder, write_table
from gaussian_trimmer.output.report import SUMMARY, SUMMARY_COLUMNS, summary_rows
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.settings import Range

ABOUT = """Trim many objects of many scenes, listed in manifests. What an earlier run has finished is not done again.

A manifest is a .csv with the columns scene, selection (or labels and objects), name, cameras, up and options; all but
scene may be left out. Results go to items/NAME in the output folder, with summary.csv beside them."""
EXAMPLES = (
    "gaussian-trimmer batch manifest.csv --output out",
    "gaussian-trimmer batch found/*/batch.csv --output out",
    'gaussian-trimmer batch manifest.csv --output out --options "--views 7 --no-write-background" --shard 1/4',
)


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run, EXAMPLES)
    manifests = "Tables of items, such as the batch.csv that 'objects' writes"
    parser.add_argument("manifests", kind=tuple[Path, ...], metavar="MANIFEST ...", help=manifests)
    output = Path("trimmed/batch")
    parser.add_argument("--output", kind=Path, metavar="DIR", default=output, help="Folder for the results")
    options = "Options of 'trim' for all items, such as \"--views 7\"; a row's own options override them"
    parser.add_argument("--options", metavar="TEXT", default="", help=options)
    workers = "Number of worker processes, each with a scene in memory; by default one for each processor"
    parser.add_argument("--workers", kind=Annotated[int, Range(1, 100_000)], help=workers)
    engine = "Where the workers run: on this machine, or on a Ray cluster (needs the extra 'ray')"
    parser.add_argument("--engine", kind=Literal["local", "ray"], default="local", help=engine)
    address = "Address of the Ray cluster, or auto for the one that this machine is part of; by default one is started"
    parser.add_argument("--address", metavar="ADDRESS", help=address)
    shard = "Only this machine's share of the items: number I, from 1, of N machines"
    parser.add_argument("--shard", metavar="I/N", default="1/1", help=shard)
    add_printing(parser)


def run(arguments: Namespace) -> None:
    """Trim everything, and write the summary.

    Raises:
        InputError: a manifest or an option is not possible, or items have failed.
    """
    console, output = console_of(arguments), arguments.output
    number, shards = _shard(arguments.shard)
    items = items_of(arguments)
    mine = items[len(items) * (number - 1) // shards : len(items) * number // shards]
    folders = {item.name: output.absolute() / "items" / item.name for item in items}
    waiting = [item for item in mine if not _is_made(item, folders[item.name])]
    earlier, failures, done = len(mine) - len(waiting), dict[str, str](), 0
    tasks = [(item.words, folders[item.name], item.files) for item in waiting]
    pool = partial(on_ray, address=arguments.address) if arguments.engine == "ray" else on_processes
    ended = pool(trim_item, tasks, arguments.workers)
    try:
        with _progress(console, len(mine), earlier) as show, closing(ended):
            for task, failure in ended:
                done += 1
                if failure:
                    failures[waiting[task].name] = failure
                show(waiting[task].name, failure)
    except KeyboardInterrupt as signal:
        said = f"Stopped after {earlier + done} of {len(mine)} items; the same command goes on."
        raise Stopped(*(signal.args or (SIGINT,)), said) from signal
    finally:
        for item in waiting:
            _remove_rest(folders[item.name], output.absolute())
    rows = [_row_of(item, folders[item.name], failures.get(item.name, "")) for item in items]
    make_folder(output)
    write_table(rows, output / SUMMARY, for_people=True)
    found = f" ({earlier} earlier)" if earlier else ""
    lost = f", {len(failures)} failed" if failures else ""
    console.print(f"{len(mine) - len(failures)} of {len(mine)} done{found}{lost}; see {output / SUMMARY}.")
    print_json(arguments, {"folder": str(output), "items": rows})
    if failures:
        first, failure = next(iter(failures.items()))
        why = f", since: {failure}" if console.quiet else "."  # else that has been printed
        raise InputError(
            f"{len(failures)} of {len(mine)} items failed, the first is {first}{why} All are in {output / SUMMARY}."
        )


def items_of(arguments: Namespace) -> list[Item]:
    """Return all items; all files are looked at.

    Raises:
        InputError: a manifest, an option or a file that a row names is not possible.
    """
    if arguments.engine == "local" and arguments.address is not None:
        raise InputError("An address is that of a cluster; leave it out, or use the engine ray.")
    if arguments.address is not None and arguments.workers is not None:
        raise InputError("A cluster that is there shares out its processors itself; leave the workers out.")
    try:
        common = parser_of("trim").parse(option_words(arguments.options))
    except InputError as error:
        raise InputError(f"--options: {error}") from error
    stamp, whole, in_parts = cache(_stamp), set[Path](), set[Path]()
    added, plain = parser_of("trim"), parser_of("trim")

    def item_of(name: str, words: Sequence[str]) -> Item:
        given = added.parse(words, common)
        all_words = tuple(plain.words_of(given)[1:])
        name = checked_name(name or trim.folder_of(given).name)
        (in_parts if given.selection or given.in_order else whole).add(given.scene)
        given.scene = trim.scene_of(given)
        files = {str(path): stamp(path) for path in _inputs(given)}
        trim.check(given)
        suffix_for(given)
        return Item(name, all_words, files)

    items = [item for path in arguments.manifests for item in read_manifest(path, item_of)]
    check_names(items)
    if both := whole & in_parts:
        raise InputError(f"'{min(both)}' has a row without a selection beside others with one; say what it is.")
    return items


def _shard(text: str) -> tuple[int, int]:
    """Return the number of this machine, from 1, and that of all."""
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise InputError(f"The shard is {clip_name(text)}; give i/n with i from 1 to n.")
    return int(found[1]), int(found[2])


def trim_item(words: Sequence[str], folder: Path, files: Mapping[str, list[int]]) -> str:
    """Trim an item as the command does; return why it failed, or nothing."""
    try:
        with redirect_stderr(io.StringIO()):  # what it warns of is in its report
            item = parser_of("trim").parse([*words, "--output", str(folder), "--overwrite", "--quiet"])
            trim.run(item, lambda scene, level, say: _read_scene(scene, level), {"files": files})
    except Exception as error:  # A defect of the program must not stop the other items.
        place = traceback.extract_tb(error.__traceback__)[-1]
        defect = f"A defect of the program: {type(error).__name__}: {error} ({place.filename}, line {place.lineno})."
        return user_message(error) or printable(defect, 1000)
    return ""


@lru_cache(maxsize=1)
def _read_scene(path: Path, level: int | None) -> Gaussians:
    """Read a scene, once for its items that follow each other in a process."""
    return formats.read(path, level=level)


def _inputs(arguments: Namespace) -> list[Path]:
    """Return the files and folders that a trim reads, without those that it finds in them."""
    found = [path for path in trim.files_of(arguments) if path != arguments.scene]
    found += [path for path in (arguments.cameras, arguments.labels) if path is not None]
    return [*formats.scene_files(identify(arguments.scene).scene, arguments.level), *found]


def _stamp(path: Path) -> list[int]:
    """Return the number of files at a path, their bytes, and their latest change in nanoseconds.

    Raises:
        InputError: there is no such file.
    """
    files = [path]
    if is_folder(path):
        files = [file for file in path.rglob("*") if file.is_file()]
    elif "*" in str(path):
        files = list(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    elif not is_file(path):  # A device or a pipe may never end.
        raise InputError(f"There is no file '{path}'.")
    found = [file.stat() for file in files]
    return [len(found), sum(one.st_size for one in found), max((one.st_mtime_ns for one in found), default=0)]


def _is_made(item: Item, folder: Path) -> bool:
    """Return whether the results of an item are whole, and made by this version from just this."""
    with suppress(InputError, OSError, LookupError, TypeError):
        report = read_json(folder / "report.json") if is_complete(folder) else {}
        made = report["version"], report["command"], report["inputs"]["files"]
        return made == (__version__, ["trim", *item.words], item.files)
    return False


def _remove_rest(folder: Path, output: Path) -> None:
    """Remove what a process that was ended has left of an item, or beside its results."""
    remove_leftovers(folder)
    for place in (folder, *folder.parents):
        if place == output:
            break
        with suppress(OSError):  # It holds results, or does not exist.
            place.rmdir()


def _row_of(item: Item, folder: Path, failure: str) -> dict[str, Any]:
    """Return what the summary says of an item: the numbers of its report, or why there is none."""
    row = dict.fromkeys(SUMMARY_COLUMNS, "") | {"name": item.name, "state": "left", "message": failure}
    if failure or not _is_made(item, folder):
        return row | ({"state": "failed"} if failure else {})
    try:
        (found,) = summary_rows(read_json(folder / "report.json"))
        return found | {"name": item.name}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"The report in '{folder}' is damaged; delete that folder, and start again.") from error


@contextmanager
def _progress(console: Console, total: int, done: int) -> Iterator[Callable[[str, str], None]]:
    """Give a function to call with the name of each item that ends, and why it failed if it did."""
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    terminal = console.is_terminal and not console.quiet
    with Progress(*columns, console=console, transient=True, disable=not terminal) as bar:
        task = bar.add_task("", total=total, completed=done)

        def show(name: str, failure: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, completed=done)
            if failure:
                console.print(f"failed: {name}: {failure}")
            elif not terminal:
                console.print(f"done: {name}, {done} of {total}")

        yield show
