"""How the commands that measure print their tables, and the files that they write."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from json import dumps
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.console import Console

from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.runs import Run
from gaussian_trimmer.evaluation.tables import ENDINGS, FORMATS, ScoreTable
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.options import arg


@dataclass(frozen=True)
class Findings:
    """What a command has measured."""

    tables: Mapping[str, ScoreTable]
    """By the name of their files."""
    runs: Sequence[Run] = ()
    """Written to `runs.json`, if there are any."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Everything that was set, written to `settings.json`."""


@dataclass(frozen=True)
class TableOptions:
    """Where tables go."""

    format: Literal["table", "csv", "latex"] = "table"
    """How to print tables."""
    json: bool = False
    """Print the tables as one JSON document instead."""
    output: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also write all tables here, in every format."""
    overwrite: bool = False
    """Replace earlier results in the output folder."""

    @property
    def for_programs(self) -> bool:
        """Whether what is printed is for programs to read."""
        return self.json or self.format != "table"

    def publish(self, measure: Callable[[], Findings], console: Console) -> None:
        """Measure, print the tables, and write them if there is a folder, which then appears whole or not at all.

        Raises:
            InputError: the folder cannot be written to or may not be replaced, which is found before anything is
                measured; or what `measure` raises.
        """
        opened = atomic_folder(self.output, "evaluate", overwrite=self.overwrite) if self.output else nullcontext()
        with opened as folder:
            found = measure()
            self._print(list(found.tables.values()), console)
            if folder is not None:
                _write(found, folder)

    def _print(self, tables: Sequence[ScoreTable], console: Console) -> None:
        if self.json:
            found = [table.as_dict() for table in tables]
            console.print(dumps(found if len(found) > 1 else found[0], indent=1, allow_nan=False))
            return
        # The notes are no rows: where CSV is printed, they are only in the files.
        console.print("\n".join(FORMATS[self.format](table).rstrip("\n") + "\n" for table in tables))


def _write(found: Findings, folder: Path) -> None:
    for name, table in found.tables.items():
        for kind, ending in ENDINGS.items():
            (folder / f"{name}{ending}").write_text(FORMATS[kind](table), encoding="utf-8")
    if found.runs:
        text = dumps([asdict(run) for run in found.runs], indent=1, allow_nan=False)
        (folder / "runs.json").write_text(text + "\n", encoding="utf-8")
    about = {name: table.about() for name, table in found.tables.items()}
    settings = {"made_by": made_by(), **found.settings, "tables": about}
    (folder / "settings.json").write_text(dumps(settings, indent=1) + "\n", encoding="utf-8")


def print_run(run: Run, console: Console) -> None:
    """Print a line on one trim."""
    metrics = [name for name in ("iou", "iou_in_scene", "boundary_iou", "psnr") if name in run.before]
    after = {name: f" -> {run.after[name]:5.1f}" for name in metrics if name in run.after}
    changes = "  ".join(f"{name} {run.before[name]:5.1f}{after.get(name, '')}" for name in metrics)
    kept = f"  fidelity {run.after['fidelity']:4.1f}" if "fidelity" in run.after else ""
    tail = f"{run.seconds:4.1f} s{'  LOSS' if run.after and run.loses() else ''} {run.refused}".rstrip()
    console.print(f"{run.variant:18s} {run.kind:12s} {run.scene}/{run.object:12s} {changes}{kept}  {tail}")
