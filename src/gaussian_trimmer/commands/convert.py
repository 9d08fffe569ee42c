"""`gaussian-trimmer convert`: one splat format to another, or to a page for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import unit_up
from gaussian_trimmer.commands.console import open_console, print_up, refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.output.engines import ENGINES, EngineName, upright
from gaussian_trimmer.output.html.document import SUFFIXES


@dataclass(frozen=True)
class Convert:
    """Convert a splat file. The endings of the names tell the formats.

    A target that ends with .html becomes a page that draws the Gaussians, up to a million, in any browser, without a
    server and without the network. It cannot be read back. A file cannot be converted into itself: what the format
    does not hold would be lost.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer convert scene.ply scene.spz",
        "gaussian-trimmer convert scene.ply scene.html --up z",
        "gaussian-trimmer convert object.ply object_unity.ply --for unity --up z",
    )

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog, the meta.json or lod-meta.json of an unbundled one,
    .ksplat, .glb, or a .ckpt of nerfstudio; or the folder of a training."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write, in one of these formats or .html."""
    level: Annotated[int | None, arg(metavar="N", default="the finest that memory allows")] = None
    """Level of detail of a streamed SOG (lod-meta.json); 0 is the finest."""
    sort: bool = False
    """Write the rows in Morton order. Compressed files get smaller and more precise, but selections no longer fit."""
    spz_version: Literal[3, 4] = 3
    """Version of an .spz target: 3, which every reader knows, or 4, which is a little smaller."""
    engine: Annotated[EngineName | None, arg(name="for")] = None
    """Turn the Gaussians so that they stand upright in this program; TARGET must have a format that it reads."""
    up: tuple[float, float, float] | None = None
    """Which way is up in SOURCE, for --for and for pages. By default the ground is looked for."""
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
        count = self._write_page(console) if page else self._convert(console)
        read = formats.scene_files(source, self.level)
        before, after = (sum(path.stat().st_size for path in paths) / 1e6 for paths in (read, [self.target]))
        console.print(f"{self.target}: {count:,} Gaussians, {after:.1f} MB instead of {before:.1f} MB")

    def _refuse_options_of_other_formats(self, page: bool) -> None:
        if self.engine is not None and not any(formats.is_named(self.target.name, end) for end in self._readable()):
            raise InputError(
                f"{self.engine} reads {', '.join(self._readable())}; name the target "
                f"'{Path(self.target.stem).stem}{self._readable()[0]}', or leave --for out."
            )
        if self.up is not None and not page and self.engine is None:
            raise InputError("--up is for pages, which end with .html, and for --for; else the axes stay as they are.")
        if self.sort and page:
            raise InputError("--sort is for splat files; a page sorts what it draws itself.")
        if self.spz_version != Convert.spz_version and not self._is_spz():
            raise InputError(f"'{self.target}' is not an .spz file; leave --spz-version out, or give it that ending.")

    def _readable(self) -> tuple[str, ...]:
        """Endings of the files that the program reads."""
        return ENGINES[self.engine].reads if self.engine else ()

    def _is_spz(self) -> bool:
        return formats.is_named(self.target.name, ".spz")

    def _convert(self, console: Console) -> int:
        options: dict[str, Any] = {"version": self.spz_version} if self._is_spz() else {}
        change = partial(self._upright, console=console) if self.engine is not None else None
        options |= {"level": self.level, "say": console.print, "sort": self.sort, "change": change}
        return len(formats.convert(self.source, self.target, **options))

    def _upright(self, gaussians: Gaussians, console: Console) -> Gaussians:
        assert self.engine is not None
        return upright(gaussians, self._found_up(gaussians, console), self.engine)

    def _write_page(self, console: Console) -> int:
        from gaussian_trimmer.output.html.viewer import write_viewer

        gaussians = formats.read(self.source, level=self.level, say=console.print)
        write_viewer({"scene": gaussians}, self.target, self._found_up(gaussians, console))
        return len(gaussians)

    def _found_up(self, gaussians: Gaussians, console: Console) -> Float64Array:
        """The up vector that is given, or else that of the ground; it is printed."""
        # Late, so that the other conversions do not load the trimmer.
        from gaussian_trimmer.geometry.limits import check_magnitudes
        from gaussian_trimmer.planning.up_vector import find_up

        check_magnitudes(gaussians)
        up = find_up(gaussians, None, None if self.up is None else unit_up(self.up))
        print_up(console, up)
        return up.direction
