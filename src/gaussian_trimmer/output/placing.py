"""`--for`, `--origin` and `--scale`, of `trim`, `objects` and `convert`: files as other programs want them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, Gaussians, concatenate
from gaussian_trimmer.io.writing import write_json
from gaussian_trimmer.options import arg
from gaussian_trimmer.output.engines import ENGINES, EngineName, Origin, Placement, placement_for
from gaussian_trimmer.output.hull import hull_as_obj
from gaussian_trimmer.settings import Range

if TYPE_CHECKING:  # conversions need no trimmer
    from gaussian_trimmer.trimming.result import TrimResult
    from gaussian_trimmer.trimming.up_vector import UpVector

POSES = "poses.json"
"""Name of the file that says where the files for a program lie in the scene."""


@dataclass(frozen=True)
class PlacingOptions:
    """How files for other programs are turned, moved and scaled."""

    engine: Annotated[EngineName | None, arg(name="for")] = None
    """Files for this program, in a format that it reads, upright, with the foot at the origin. Trims write them beside
    the others, with poses.json."""
    origin: Annotated[Origin | None, arg(default="foot with --for, else scene")] = None
    """What lies at the origin of those files: the middle of the foot, or of the box, or the scene's own origin."""
    scale: Annotated[float, Range(1e-6, 1e6)] = 1.0
    """Units of those files in a unit of the scene, such as 100 for centimetres."""

    @property
    def wished(self) -> bool:
        """Whether files other than the scene's are asked for."""
        return self != PlacingOptions()

    @property
    def needs_up(self) -> bool:
        """Whether it matters which way is up."""
        return self.engine is not None or self.origin in ("foot", "centre")

    def placement(self, gaussians: Gaussians, up: Sequence[float] | Float64Array) -> Placement:
        """Return where Gaussians are put."""
        origin: Origin = self.origin or ("scene" if self.engine is None else "foot")
        return placement_for(gaussians, up, engine=self.engine, origin=origin, scale=self.scale)

    def patterns(self, suffix: str) -> tuple[str, ...]:
        """Return patterns of the names of all files that `write` writes."""
        if not self.wished:
            return ()
        ending = self._ending(suffix)
        return f"object{ending}", f"object_*{ending}", f"background{ending}", "object*_hull.obj", POSES

    def write(self, result: TrimResult, folder: Path, suffix: str, *, background: bool = True) -> list[str]:
        """Write objects and background of a trim into an existing folder; return the names of the files.

        Each object has its own foot at the origin, and a convex hull; the background has the foot of all objects
        together, so that a single object fits it; `poses.json` says where each file lies in the scene.

        Args:
            result: the trim.
            folder: where to write.
            suffix: ending of the scene's own files, which those have that are for no program.
            background: write the background too.

        Raises:
            InputError: a file cannot be written, or the format cannot hold the Gaussians.
        """
        from gaussian_trimmer.output.report import file_stems

        ending, up, poses = self._ending(suffix), result.objects[0].up.direction, dict[str, Any]()
        stems = file_stems((part.id, part.name) for part in result.objects)
        parts = [part for part in result.objects if len(part.gaussians)]
        for part in parts:
            place, name = self.placement(part.gaussians, up), f"{stems[part.id]}{ending}"
            placed, hull = place.apply(part.gaussians), f"{stems[part.id]}_hull.obj"
            formats.write(placed, folder / name)
            (folder / hull).write_text(hull_as_obj(placed), encoding="utf-8")
            poses[name] = place.as_json(part.gaussians) | {"hull": hull}
        if background and parts and len(result.background):
            place = self.placement(concatenate([part.gaussians for part in parts]), up)
            formats.write(place.apply(result.background), folder / f"background{ending}")
            poses[f"background{ending}"] = place.as_json()
        if poses:
            write_json({"up": up.tolist(), "files": poses}, folder / POSES)
        return list(poses)

    def sentence(self, files: list[str], up: UpVector) -> str:
        """Return what to say of the files that were written."""
        said = f"For {ENGINES[self.engine].name}" if self.engine else "Placed"
        turned = "" if self.engine is None else ", upright" if up.is_sure else ", upright if the up vector is right"
        where = "they lie" if len(files) > 1 else "it lies"
        return f"{said}{turned}: {', '.join(files)}; {POSES} says where {where}."

    def check_target(self, target: Path) -> None:
        """Refuse a file that the program does not read.

        Raises:
            InputError: its name has another ending.
        """
        reads = ENGINES[self.engine].reads if self.engine else ()
        if reads and not any(formats.is_named(target.name, end) for end in reads):
            raise InputError(
                f"{self.engine} reads {', '.join(reads)}; name the target '{Path(target.stem).stem}{reads[0]}', or "
                "leave --for out."
            )

    def _ending(self, suffix: str) -> str:
        """Return how names of files end."""
        return f"_for_{self.engine}{ENGINES[self.engine].reads[0]}" if self.engine else f"_placed{suffix}"
