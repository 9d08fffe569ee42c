"""`gaussian-trimmer batch`: many objects of many scenes, from a manifest."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from rich.console import Console
from rich.live import Live
from rich.table import Table
from tyro.conf import Positional, arg

from gaussian_trimmer.batch.execution import run
from gaussian_trimmer.batch.items import Item, check_items
from gaussian_trimmer.batch.manifest import read_manifest
from gaussian_trimmer.batch.outcomes import Outcome, Status
from gaussian_trimmer.batch.storage import Store, open_store
from gaussian_trimmer.batch.summary import HTML, write_summaries
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.errors import InputError, printable

_SHOWN_WORKERS = 16
_SECONDS_BETWEEN_LINES = 30.0


@dataclass(frozen=True)
class Batch:
    """Trim many objects of many scenes, listed in MANIFEST; what an earlier run has finished is not done again.

    The manifest is a .csv or .jsonl with the columns scene, selection (or labels and objects), name, cameras, up and
    options; all but scene may be left out. Results go to items/NAME in the output folder, with summary.csv and
    summary.html beside them.
    """

    manifest: Annotated[Positional[Path], arg(metavar="MANIFEST")]
    """Table of items, .csv or .jsonl."""
    output: Annotated[str, arg(metavar="DIR")] = "trimmed/batch"
    """Folder for the results, or an address that fsspec opens, such as s3://bucket/results."""
    workers: Annotated[int | None, arg(metavar="INT", help_behavior_hint="(default: one for each processor)")] = None
    """Number of worker processes."""
    engine: Literal["local", "ray"] = "local"
    """Where the workers are: on this machine, or on a Ray cluster (needs gaussian-trimmer[ray])."""
    address: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="(default: start one here)")] = None
    """Address of the Ray cluster; auto for the one that this machine is part of."""
    gpus: float = 0.0
    """What each worker takes of the GPUs of a cluster."""
    shard: Annotated[str | None, arg(metavar="I/N")] = None
    """Only the scenes of the I-th of N machines, from 1."""
    options: Annotated[str, arg(metavar="TEXT")] = ""
    """Options of 'gaussian-trimmer trim' for all items, such as "--views 7"; those of a row come after them."""
    background: bool = True
    """Write the scene without the object for every item; each is nearly as large as its scene."""
    time_limit: Annotated[float | None, arg(metavar="SECONDS")] = None
    """What one item, with the reading of its scene, may take."""
    retries: int = 1
    """How many times an item is tried again, alone, whose worker has died."""
    retry_failed: bool = False
    """Try those items again that failed in an earlier run."""
    memory: Annotated[float | None, arg(metavar="GB", help_behavior_hint="(default: 80 % of what is free)")] = None
    """Memory that all workers on this machine may take together."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Trim everything, and write the summaries.

        Raises:
            InputError: the manifest or an option is not possible, nothing can be written, or items have failed.
        """
        console = open_console(quiet=self.quiet)
        items = check_items(read_manifest(self.manifest, self.options))
        items = [replace(item, background=self.background) for item in items]
        store, outcomes = open_store(self.output), list[Outcome]()
        _remove_old_records(store, items)
        try:
            with _progress(console) as progress:
                self._run(items, outcomes, progress)
        except InputError:
            if outcomes:
                with suppress(InputError):  # What stopped the batch is what should be reported.
                    write_summaries(store, items, outcomes)
            raise
        write_summaries(store, items, outcomes)
        self._report_end(console, outcomes)

    def _run(self, items: list[Item], outcomes: list[Outcome], progress: _Progress) -> None:
        def on_result(outcome: Outcome) -> None:
            outcomes.append(outcome)
            progress.show_outcome(outcome)

        run(
            items,
            self.output,
            on_result=on_result,
            on_status=progress.show_status,
            workers=self.workers,
            engine=self.engine,
            address=self.address,
            gpus=self.gpus,
            shard=_shard(self.shard),
            time_limit=self.time_limit,
            retries=self.retries,
            retry_failed=self.retry_failed,
            memory=None if self.memory is None else 1e9 * self.memory,
        )

    def _report_end(self, console: Console, outcomes: list[Outcome]) -> None:
        """Say what became of the batch.

        Raises:
            InputError: items have failed.
        """
        done = [outcome for outcome in outcomes if outcome.state == "done"]
        found = sum(not outcome.fresh for outcome in done)
        failed = [outcome for outcome in outcomes if outcome.state == "failed"]
        earlier = f", {found} of them by an earlier run" if found else ""
        console.print(f"{len(done)} of {len(outcomes)} items are finished{earlier}; see {self.output}/{HTML}.")
        if failed:
            again = "" if any(outcome.fresh for outcome in failed) else "; --retry-failed tries them again"
            raise InputError(
                f"{len(failed)} of {len(outcomes)} items failed; the first: {failed[0].item.name}: "
                f"{failed[0].message} All are in summary.csv{again}."
            )


def _remove_old_records(store: Store, items: list[Item]) -> None:
    """Remove the records of failed items that are no longer in the manifest."""
    names = {item.name for item in items}
    store.remove_records(*(name for name in store.recorded() if name not in names))


def _shard(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if not found:
        raise InputError(f"The shard is '{text}'; give i/n with i from 1 to n.")
    return int(found[1]), int(found[2])


@dataclass
class _Progress:
    """Progress as lines: one for each item that fails, and one now and then; or on a terminal as a live table."""

    console: Console
    live: Live | None = None
    started: float = field(default_factory=time.monotonic)
    printed: float = field(default_factory=time.monotonic)

    def show_outcome(self, outcome: Outcome) -> None:
        """Say that an item has failed."""
        if outcome.state == "failed":
            self.console.print(f"failed: {outcome.item.name}: {outcome.message}")

    def show_status(self, status: Status) -> None:
        """Say how far the batch is."""
        now = time.monotonic()
        line = _line(status, now - self.started)
        if self.live is not None:
            self.live.update(_table(line, status))
        elif now - self.printed >= _SECONDS_BETWEEN_LINES:
            self.printed = now
            self.console.print(line)


@contextmanager
def _progress(console: Console) -> Iterator[_Progress]:
    if console.quiet or not console.is_terminal:
        yield _Progress(console)
        return
    with Live(console=console, transient=True, refresh_per_second=4) as live:
        yield _Progress(console, live)


def _table(line: str, status: Status) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_row(line)
    for worker, (name, seconds) in sorted(status.running.items())[:_SHOWN_WORKERS]:
        table.add_row(f"  worker {worker}: {printable(name, 60)}, {seconds:.0f} s")
    if len(status.running) > _SHOWN_WORKERS:
        table.add_row(f"  and {len(status.running) - _SHOWN_WORKERS} more workers")
    return table


def _line(status: Status, seconds: float) -> str:
    """How far a batch is, and, if this run has done any item itself, how fast it is and how long it will take.

    >>> _line(Status(total=10, done=4, failed=1, found=1, running={}), 60.0)
    '5 of 10 items, 1 failed, 1 from before; 4.0 a minute, 1 min left'
    >>> _line(Status(total=10, done=9, failed=0, found=9, running={}), 60.0)
    '9 of 10 items, 9 from before'
    """
    finished = status.done + status.failed
    fresh, left = finished - status.found, status.total - finished
    parts = [f"{finished} of {status.total} items"]
    parts += [f"{status.failed} failed"] * bool(status.failed) + [f"{status.found} from before"] * bool(status.found)
    line = ", ".join(parts)
    if not fresh:
        return line
    rate = 60 * fresh / max(seconds, 1e-9)
    return f"{line}; {rate:.1f} a minute" + (f", {_duration(60 * left / rate)} left" if left else "")


def _duration(seconds: float) -> str:
    """A time that someone waits for.

    >>> [_duration(seconds) for seconds in (20, 100, 10000)]
    ['20 s', '2 min', '2 h 47 min']
    """
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
