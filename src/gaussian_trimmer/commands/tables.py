"""How the commands that measure show their tables, and the files that they write."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.console import Console
from tyro.conf import arg

from gaussian_trimmer.evaluation.tables import ENDINGS, FORMATS, ScoreTable
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.pictures import Picture, write_picture

_KIND = "evaluate"
"""What writes the folder, as far as replacing earlier results is concerned."""


@dataclass(frozen=True)
class TableOptions:
    """Where tables go."""

    format: Literal["table", "csv", "json", "latex"] = "table"
    """How tables are printed."""
    output: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder to which all tables are also written, as .md, .csv, .json and .tex, with pictures."""
    overwrite: bool = False
    """Replace earlier results in the output folder."""


@dataclass(frozen=True)
class Findings:
    """What a command has measured: tables by the name of their files, pictures, texts and raw figures."""

    tables: Mapping[str, ScoreTable]
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    """By the path of their files in the output folder."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """By the name of their files, drawings included."""
    figures: Sequence[Mapping[str, Any]] | None = None
    """Written to `runs.json`."""


@contextmanager
def results_folder(options: TableOptions) -> Iterator[Path | None]:
    """The folder to write to, or None if none is wished for; to be opened before anything is measured.

    It appears whole at the end, and not at all if there is an error.

    Raises:
        InputError: the folder cannot be written to, or holds something that may not be replaced.
    """
    if options.output is None:
        yield None
        return
    with atomic_folder(options.output, _KIND, overwrite=options.overwrite) as folder:
        yield folder


def publish(findings: Findings, options: TableOptions, console: Console, folder: Path | None) -> None:
    """Print the tables, and write everything if there is a folder for it.

    Raises:
        InputError: a picture cannot be written.
    """
    tables = list(findings.tables.values())
    if options.format == "json" and len(tables) > 1:  # one document, whatever the number of tables
        console.print(json.dumps([table.as_dict() for table in tables], indent=1, allow_nan=False))
    else:
        for table in tables:
            console.print(FORMATS[options.format](table))
    if folder is None:
        return
    for name, table in findings.tables.items():
        for kind, ending in ENDINGS.items():
            (folder / f"{name}{ending}").write_text(FORMATS[kind](table), encoding="utf-8")
    for name, picture in findings.pictures.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_picture(picture, folder / name)
    for name, text in findings.texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    if findings.figures is not None:
        text = json.dumps(findings.figures, indent=1, allow_nan=False)
        (folder / "runs.json").write_text(text + "\n", encoding="utf-8")
