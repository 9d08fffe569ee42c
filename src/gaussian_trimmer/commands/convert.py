"""`gaussian-trimmer convert`: one splat format to another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.commands.console import open_console, refuse_existing


@dataclass(frozen=True)
class Convert:
    """Convert a splat file; the endings of the names tell the formats.

    A file cannot be converted into itself: what the format does not hold would be lost.
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog, .ksplat or .glb."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write."""
    sort: bool = False
    """Write the rows in Morton order: smaller and more precise compressed files, but selections no longer fit."""
    overwrite: bool = False
    """Replace the target if it exists."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Read, write, and print how large the files are.

        Raises:
            InputError: the source cannot be read, or the target is the source, exists, or cannot be written.
        """
        refuse_existing(self.target, inputs=[self.source], overwrite=self.overwrite)
        written = formats.convert(self.source, self.target, sort=self.sort)
        before, after = (path.stat().st_size / 1e6 for path in (self.source, self.target))
        open_console(quiet=self.quiet).print(
            f"{self.target}: {len(written):,} Gaussians, {after:.1f} MB instead of {before:.1f} MB"
        )
