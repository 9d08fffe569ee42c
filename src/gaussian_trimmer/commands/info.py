"""`gaussian-trimmer info`: what files are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from gaussian_trimmer.commands.console import PrintOptions
from gaussian_trimmer.commands.inspection import describe_file
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.options import Positional, arg


@dataclass(frozen=True)
class Info:
    """Say what splat files, selections and camera files hold, and how a selection can be used."""

    files: Positional[tuple[Path, ...]]
    """Files, or folders with cameras."""
    level: Annotated[int | None, arg(metavar="N", default="the finest that memory allows")] = None
    """Level of detail of streamed SOGs (lod-meta.json) to describe; 0 is the finest."""
    trust_paths: bool = False
    """Open pictures that a transforms.json names outside its folder, if it does not say their size."""
    printing: Annotated[PrintOptions, arg(name="")] = field(default_factory=PrintOptions)

    def run(self) -> None:
        """Print a paragraph on every file.

        Raises:
            InputError: no file is named, or one is missing, of no known kind, or damaged.
        """
        if not self.files:
            raise InputError("Name at least one file.")
        console, files = self.printing.console(), list[dict[str, Any]]()
        for path in self.files:
            facts = dict[str, Any]()
            said = describe_file(path, level=self.level, trust_paths=self.trust_paths, facts=facts)
            console.print(said)
            files.append({"file": str(path), "said": said, **facts})
        self.printing.print_json({"files": files})
