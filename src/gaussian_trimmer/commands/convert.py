"""`gaussian-trimmer convert`: one splat format to another, or to a page for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

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
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog or the meta.json of an unbundled one, .ksplat, .glb, or a
    .ckpt of nerfstudio; or the folder of a training."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write, in one of these formats or .html."""
    sort: bool = False
    """Write the rows in Morton order: smaller and more precise compressed files, but selections no longer fit."""
    spz_version: Literal[3, 4] = 3
    """Version of an .spz target: 3, which everything reads, or 4, which is a little smaller."""
    up: tuple[float, float, float] | None = None
    """Up vector around which a page turns the Gaussians; if it is not given, the ground is looked for."""
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
        refuse_existing(self.target, inputs=[source], overwrite=self.overwrite)
        page = self.target.suffix.lower() in SUFFIXES
        self._refuse_options_of_other_formats(page)
        console = open_console(quiet=self.quiet)
        if source != self.source:
            console.print(f"{self.source}: reading {source}")
        count = self._write_page(source, console) if page else self._convert(source)
        before, after = (path.stat().st_size / 1e6 for path in (source, self.target))
        console.print(f"{self.target}: {count:,} Gaussians, {after:.1f} MB instead of {before:.1f} MB")

    def _refuse_options_of_other_formats(self, page: bool) -> None:
        if self.up is not None and not page:
            raise InputError("--up is for pages, which end with .html; other formats keep the scene's axes.")
        if self.sort and page:
            raise InputError("--sort is for splat files; a page sorts what it draws itself.")
        if self.spz_version != Convert.spz_version and not self._is_spz():
            raise InputError(f"'{self.target}' is not an .spz file; leave --spz-version out, or give it that ending.")

    def _is_spz(self) -> bool:
        return formats.is_named(self.target.name, ".spz")

    def _convert(self, source: Path) -> int:
        options = {"version": self.spz_version} if self._is_spz() else {}
        return len(formats.convert(source, self.target, sort=self.sort, **options))

    def _write_page(self, source: Path, console: Console) -> int:
        # Late, so that the other conversions do not load the trimmer.
        from gaussian_trimmer.geometry.limits import check_magnitudes
        from gaussian_trimmer.output.html.viewer import write_viewer
        from gaussian_trimmer.planning.up_vector import find_up

        given = None if self.up is None else unit_up(self.up)
        gaussians = formats.read(source)
        check_magnitudes(gaussians)
        up = find_up(gaussians, None, given)
        print_up(console, up)
        write_viewer({"scene": gaussians}, self.target, up.direction)
        return len(gaussians)
