"""`gaussian-trimmer convert`: one splat format to another, or to a page for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import unit_up
from gaussian_trimmer.commands.console import open_console, print_up, refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.output.html.document import SUFFIXES


@dataclass(frozen=True)
class Convert:
    """Convert a splat file; the endings of the names tell the formats.

    A target that ends with .html becomes a page that draws the Gaussians, up to a million, in any browser, without a
    server and without the network. It cannot be read back. A file cannot be converted into itself: what the format
    does not hold would be lost.
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog, .ksplat or .glb."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write, in one of these formats or .html."""
    sort: bool = False
    """Write the rows in Morton order: smaller and more precise compressed files, but selections no longer fit."""
    up: tuple[float, float, float] | None = None
    """Up vector around which a page turns the Gaussians; if it is not given, the ground is looked for."""
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
        console, page = open_console(quiet=self.quiet), self.target.suffix.lower() in SUFFIXES
        if self.up is not None and not page:
            raise InputError("--up is for pages, which end with .html; other formats keep the scene's axes.")
        if self.sort and page:
            raise InputError("--sort is for splat files; a page sorts what it draws itself.")
        count = self._write_page(console) if page else self._convert()
        before, after = (path.stat().st_size / 1e6 for path in (self.source, self.target))
        console.print(f"{self.target}: {count:,} Gaussians, {after:.1f} MB instead of {before:.1f} MB")

    def _convert(self) -> int:
        return len(formats.convert(self.source, self.target, sort=self.sort))

    def _write_page(self, console: Console) -> int:
        # Late, so that the other conversions do not load the trimmer.
        from gaussian_trimmer.output.html.viewer import write_viewer
        from gaussian_trimmer.planning.up_vector import find_up
        from gaussian_trimmer.scene_limits import check_magnitudes

        given = None if self.up is None else unit_up(self.up)
        gaussians = formats.read(self.source)
        check_magnitudes(gaussians)
        up = find_up(gaussians, None, given)
        print_up(console, up)
        write_viewer({"scene": gaussians}, self.target, up.direction)
        return len(gaussians)
