"""`gaussian-trimmer convert`: one splat format to another."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.commands.console import PrintOptions, print_up, refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.output.engines import PlacingOptions
from gaussian_trimmer.trimming.up_vector import DEFAULT_UP, find_up


@dataclass(frozen=True)
class Convert:
    """Convert a splat file. The endings of the names tell the formats.

    A file cannot be converted into itself: what the format does not hold would be lost.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer convert scene.ply scene.spz",
        "gaussian-trimmer convert object.ply object_unity.ply --for unity --up z",
    )

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """File to read: .ply, .compressed.ply, .splat, .spz, .sog, the meta.json or lod-meta.json of an unbundled one,
    .glb, or a .ckpt of nerfstudio; or the folder of a training."""
    target: Annotated[Positional[Path], arg(metavar="TARGET")]
    """File to write, in one of these formats."""
    level: Annotated[int | None, arg(metavar="N", default="the finest that memory allows")] = None
    """Level of detail of a streamed SOG (lod-meta.json); 0 is the finest."""
    sort: bool = False
    """Write the rows in Morton order. Compressed files get smaller and more precise, but selections no longer fit."""
    spz_version: Literal[3, 4] = 3
    """Version of an .spz target: 3, which every reader knows, or 4, which is a little smaller."""
    placing: Annotated[PlacingOptions, arg(name="")] = field(default_factory=PlacingOptions)
    up: tuple[float, float, float] | None = None
    """Which way is up in SOURCE, for --for and --origin. By default the ground is looked for."""
    overwrite: bool = False
    """Replace the target if it exists."""
    printing: Annotated[PrintOptions, arg(name="")] = field(default_factory=PrintOptions)

    def run(self) -> None:
        """Read, write, and print how large the files are.

        Raises:
            InputError: the source cannot be read, or the target is the source, exists, or cannot be written, or
                has no versions.
        """
        source = identify(self.source).scene
        refuse_existing(self.target, inputs=[source], overwrite=self.overwrite)
        self._refuse_options_of_other_formats()
        console = self.printing.console()
        said = self._convert(source, console)
        read = formats.scene_files(source, self.level)
        before, after = (sum(path.stat().st_size for path in paths) for paths in (read, [self.target]))
        console.print(
            f"{self.target}: {said['gaussians']:,} Gaussians, {after / 1e6:.1f} MB instead of {before / 1e6:.1f} MB"
        )
        for sentence in said["notes"]:
            console.print(sentence)
        self.printing.print_json({"file": str(self.target), "bytes": after, "bytes_of_source": before, **said})

    def _refuse_options_of_other_formats(self) -> None:
        self.placing.check_target(self.target)
        if self.up is not None and not self.placing.needs_up:
            raise InputError("--up is for --for and --origin; else the axes stay.")
        if self.spz_version != Convert.spz_version and not self._is_spz():
            raise InputError(f"'{self.target}' is not an .spz file; leave --spz-version out, or give it that ending.")

    def _is_spz(self) -> bool:
        return formats.is_named(self.target.name, ".spz")

    def _convert(self, source: Path, console: Console) -> dict[str, Any]:
        """Write the target; return what there is to say of it."""
        notes, placed = list[str](), dict[str, Any]()

        def change(gaussians: Gaussians) -> Gaussians:
            target, own = formats.format_suffix(self.target), formats.written_suffix(source)
            notes.extend(filter(None, [formats.losses(gaussians, target, own)]))
            if not self.placing.wished:
                return gaussians
            up = self._found_up(gaussians, console) if self.placing.needs_up else DEFAULT_UP
            place = self.placing.placement(gaussians, up)
            placed.update(place.as_json())
            if place.origin.any():
                at = " ".join(f"{value:.4g}" for value in place.origin)
                notes.append(f"The origin is {at} of the scene; with --origin scene it stays.")
            return place.apply(gaussians)

        options: dict[str, Any] = {"version": self.spz_version} if self._is_spz() else {}
        options |= {"level": self.level, "say": console.print, "sort": self.sort, "change": change}
        count = len(formats.convert(self.source, self.target, **options))
        return {"gaussians": count, "notes": notes, **placed}

    def _found_up(self, gaussians: Gaussians, console: Console) -> Float64Array:
        """The up vector that is given, or else that of the ground; it is printed.

        Raises:
            InputError: nothing tells which way is up, and a file would be called upright by a guess.
        """
        check_magnitudes(gaussians)
        up = find_up(gaussians, given=self.up)
        if up.confidence == 0 and self.placing.wished:
            raise InputError(f"Nothing in '{self.source}' tells which way is up; give --up, such as --up -y.")
        print_up(console, up)
        return up.direction
