"""`gaussian-trimmer convert`: one splat format to another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.commands.console import open_console, refuse_existing
from gaussian_trimmer.errors import InputError


@dataclass(frozen=True)
class Convert:
    """Convert a splat file; the endings of the names tell the formats.

    A file cannot be converted into itself: what the format does not hold would be lost.
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog or the meta.json of an unbundled one, .ksplat, .glb, or a
    .ckpt of nerfstudio; or the folder of a training."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write."""
    sort: bool = False
    """Write the rows in Morton order: smaller and more precise compressed files, but selections no longer fit."""
    spz_version: Literal[3, 4] = 3
    """Version of an .spz target: 3, which everything reads, or 4, which is a little smaller."""
    overwrite: bool = False
    """Replace the target if it exists."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Read, write, and print how large the files are.

        Raises:
            InputError: the source cannot be read, or the target is the source, exists, or cannot be written, or
                has no versions.
        """
        source = formats.find_scene(self.source)
        is_spz = formats.is_named(self.target.name, ".spz")
        if self.spz_version != Convert.spz_version and not is_spz:
            raise InputError(f"'{self.target}' is no .spz file; leave --spz-version out, or give it that ending.")
        refuse_existing(self.target, inputs=[source], overwrite=self.overwrite)
        console = open_console(quiet=self.quiet)
        if source != self.source:
            console.print(f"{self.source}: reading {source}")
        options = {"version": self.spz_version} if is_spz else {}
        written = formats.convert(source, self.target, sort=self.sort, **options)
        before, after = (path.stat().st_size / 1e6 for path in (source, self.target))
        console.print(f"{self.target}: {len(written):,} Gaussians, {after:.1f} MB instead of {before:.1f} MB")
