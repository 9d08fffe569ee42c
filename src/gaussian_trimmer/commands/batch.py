"""`gaussian-trimmer batch`: many objects of many scenes, from a manifest."""

from __future__ import annotations

import time
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from datetime import timedelta
from pathlib import Path
from typing import Annotated, ClassVar

from rich.console import Console
from rich.status import Status as RichStatus

from gaussian_trimmer.batch.items import check_items
from gaussian_trimmer.batch.manifest import read_manifest
from gaussian_trimmer.batch.running import BatchOptions, Status, run
from gaussian_trimmer.batch.store import Outcome, Store
from gaussian_trimmer.batch.summary import CSV, HTML, row_of, write_summaries
from gaussian_trimmer.commands.console import PrintOptions
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.stop_signals import Stopped
from gaussian_trimmer.options import Positional, arg


@dataclass(frozen=True)
class Batch:
    """Trim many objects of many scenes, listed in manifests. What an earlier run has finished is not done again.

    A manifest is a .csv or .jsonl with the columns scene, selection (or labels and objects), name, cameras, up and
    options; all but scene may be left out. Results go to items/NAME in the output folder, with summary.csv and
    summary.html beside them.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer batch manifest.csv --output out",
        "gaussian-trimmer batch found/*/batch.csv --output out",
        'gaussian-trimmer batch manifest.csv --output out --options "--views 7" --no-background --shard 1/4',
    )

    manifests: Annotated[Positional[tuple[Path, ...]], arg(metavar="MANIFEST ...")]
    """Tables of items, .csv or .jsonl, such as the batch.csv that 'objects' writes."""
    output: Annotated[Path, arg(metavar="DIR")] = Path("trimmed/batch")
    """Folder for the results."""
    options: Annotated[str, arg(metavar="TEXT", of_options=True)] = ""
    """Options of 'gaussian-trimmer trim' for all items, such as "--views 7". A row's own options override them."""
    background: bool = True
    """Also write the scene without the object for every item. Each is nearly as large as its scene."""
    printing: Annotated[PrintOptions, arg(name="")] = field(default_factory=PrintOptions)
    how: Annotated[BatchOptions, arg(name="")] = field(default_factory=BatchOptions)

    def run(self) -> None:
        """Trim everything, and write the summaries.

        Raises:
            InputError: the manifest or an option is not possible, nothing can be written, or items have failed.
        """
        console = self.printing.console()
        items = check_items(item for path in self.manifests for item in read_manifest(path, self.options))
        items = [replace(item, background=self.background) for item in items]
        store, outcomes = Store(self.output), list[Outcome]()
        live = console.status("") if console.is_terminal and not console.quiet else None
        progress = _Progress(console, live, len(items))

        def on_result(outcome: Outcome) -> None:
            outcomes.append(outcome)
            progress.show_outcome(outcome)

        try:
            with live or nullcontext():
                run(items, self.output, on_result=on_result, on_status=progress.show_status, **vars(self.how))
        except InputError:
            if outcomes:
                with suppress(InputError):  # What stopped the batch is what should be reported.
                    write_summaries(store, items, outcomes)
            raise
        except Stopped as signal:
            said = f"Stopped after {len(outcomes)} of {progress.total} items; the same command goes on."
            raise Stopped(*signal.args, said) from signal
        write_summaries(store, items, outcomes)
        self._report_end(console, outcomes)

    def _report_end(self, console: Console, outcomes: list[Outcome]) -> None:
        """Say what became of the batch, as an error if items have failed."""
        done = [outcome for outcome in outcomes if outcome.state == "done"]
        found = sum(not outcome.fresh for outcome in done)
        failed = [outcome for outcome in outcomes if outcome.state == "failed"]
        earlier = f" ({found} earlier)" if found else ""
        lost = f", {len(failed)} failed" if failed else ""
        console.print(f"{len(done)} of {len(outcomes)} done{earlier}{lost}; see {self.output}/{HTML}.")
        self.printing.print_json({"folder": str(self.output), "items": [row_of(outcome) for outcome in outcomes]})
        if failed:
            again = "" if any(outcome.fresh for outcome in failed) else "; --retry-failed tries them again"
            why = f", since: {failed[0].message}" if console.quiet else "."  # else that has been printed
            raise InputError(
                f"{len(failed)} of {len(outcomes)} items failed, the first is {failed[0].item.name}{why} All are in "
                f"{self.output / CSV}{again}."
            )


@dataclass
class _Progress:
    """A line for each item that fails, and how far the batch is: below them, or without a terminal after each item."""

    console: Console
    live: RichStatus | None
    total: int
    """Number of items, of a shard if that is all of this run."""
    started: float = field(default_factory=time.monotonic)
    finished: list[str] = field(default_factory=list)
    """What is to be said of items that have ended since the last line."""

    def show_outcome(self, outcome: Outcome) -> None:
        """Remember that an item has failed or is done; on a terminal, say the first at once."""
        if outcome.state == "failed":
            line = f"failed: {outcome.item.name}: {outcome.message}"
            if self.live is not None:
                self.console.print(line)
            self.finished.append(line)
        elif outcome.state == "done" and outcome.fresh:
            self.finished.append(f"done: {outcome.item.name}, {outcome.seconds:.1f} s")

    def show_status(self, status: Status) -> None:
        """Say how far the batch is, if that is farther than before."""
        self.total = status.total
        line = _line(status, time.monotonic() - self.started)
        if self.live is not None:
            self.live.update(line)
        elif self.finished:
            self.console.print("\n".join([*self.finished, line]))
        self.finished.clear()


def _line(status: Status, seconds: float) -> str:
    """How far a batch is, and, if this run has done any item itself, how fast it is and how long it will take.

    >>> _line(Status(total=10, done=4, failed=1, found=1), 60.0)
    '5 of 10 items, 1 failed, 1 from before; 4.0 a minute, 0:01:15 left'
    >>> _line(Status(total=10, done=9, failed=0, found=9), 60.0)
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
    return f"{line}; {rate:.1f} a minute" + (f", {timedelta(seconds=round(60 * left / rate))} left" if left else "")
