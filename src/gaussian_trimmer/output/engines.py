"""Files for other programs: in a format that each reads, upright, with the foot at the origin.

`docs/engines.md` says where the facts come from, and what remains to be set in each program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import unit_up, vector_of_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.torch_files import write_mask
from gaussian_trimmer.gaussians import (
    Float64Array,
    Gaussians,
    IntArray,
    concatenate,
    ellipsoid_points,
    mask_of_rows,
    quaternions_of,
)
from gaussian_trimmer.geometry.harmonics import turned
from gaussian_trimmer.io.writing import write_json, write_whole
from gaussian_trimmer.output.usd_stage import background_in_stage, object_in_stage, stage_of
from gaussian_trimmer.settings import Range

if TYPE_CHECKING:  # conversions need neither kernels nor a trimmer
    from gaussian_trimmer.geometry.bounds import Bounds
    from gaussian_trimmer.trimming.result import TrimmedObject, TrimResult
    from gaussian_trimmer.trimming.up_vector import UpVector

EngineName = Literal["blender", "cesium", "gsplat", "instances", "playcanvas", "three", "unity", "unreal", "usd", "web"]
Origin = Literal["foot", "centre", "scene"]
POSES = "poses.json"
"""Name of the file that says where the files for a program lie in the scene."""
STAGE = "scene.usda"
"""Name of the stage that refers to the files for USD."""
INSTANCES = ("instances.ply", "instances.json")
"""Names of the file that has all objects, and of that which says what they are."""
_COLUMN = "instance_id"
_DOWN_Y = (0.0, -1.0, 0.0)
_CORNERS = 128
"""Directions in which the farthest point is a corner of a hull: engines take a few hundred corners at most."""


@dataclass(frozen=True)
class Engine:
    """What a program expects of a splat file."""

    name: str
    """As the program calls itself."""
    reads: tuple[str, ...]
    """Endings of splat files that it reads, the first is the usual one; none if it is for files of other kinds."""
    up: tuple[float, float, float] | None
    """Where up must point in the file so that the object stands upright; None: the scene's axes stay."""


_WEB_READS = (".spz", ".ply", ".compressed.ply", ".splat", ".sog")
ENGINES: dict[EngineName, Engine] = {
    "blender": Engine("Blender", (".ply",), (0.0, 0.0, 1.0)),
    "cesium": Engine("Cesium", (".ply",), _DOWN_Y),
    "gsplat": Engine("gsplat", (), None),
    "instances": Engine("instances", (), None),
    "playcanvas": Engine("PlayCanvas", (".sog", ".ply", ".compressed.ply"), _DOWN_Y),
    "three": Engine("three.js", _WEB_READS, (0.0, 1.0, 0.0)),
    "unity": Engine("Unity", (".ply", ".spz"), _DOWN_Y),
    "unreal": Engine("Unreal", (".ply",), _DOWN_Y),
    "usd": Engine("USD", (".ply", ".spz"), (0.0, 0.0, 1.0)),
    "web": Engine("Web viewers", _WEB_READS, (0.0, 1.0, 0.0)),
}
assert tuple(ENGINES) == get_args(EngineName)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a point x of the scene lies in a file: at scale * rotation @ (x - origin)."""

    rotation: Float64Array
    """From the scene's axes to the file's, (3, 3)."""
    origin: Float64Array
    """The point of the scene that is the file's origin, (3,)."""
    scale: float
    """Units of the file in one of the scene."""

    def apply(self, gaussians: Gaussians) -> Gaussians:
        """Return Gaussians of the scene as the file has them."""
        if self.origin.any():
            gaussians = gaussians.replace(means=(gaussians.means - self.origin).astype(np.float32))
        moved, factor = turned(gaussians, self.rotation), np.float32(self.scale)
        if factor == 1:
            return moved
        return moved.replace(means=moved.means * factor, log_scales=moved.log_scales + np.log(factor))

    def within(self, other: Placement) -> Placement:
        """Return the same for a point of another file in place of the scene."""
        origin = other.scale * other.rotation @ (self.origin - other.origin)
        return Placement(self.rotation @ other.rotation.T, origin, self.scale / other.scale)

    def matrix(self) -> Float64Array:
        """Return what takes points of the file to the scene, (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation.T / self.scale, self.origin
        return pose

    def pose(self, gaussians: Gaussians | None = None) -> dict[str, Any]:
        """Return `matrix` as translation, quaternion (w, x, y, z) and scale; of Gaussians the box in the file, too."""
        quaternion = quaternions_of(self.rotation.T[None])[0]
        said = {"translation": self.origin.tolist(), "quaternion": quaternion.tolist(), "scale": 1 / self.scale}
        if gaussians is None:
            return said
        bounds = _bounds(gaussians, self.rotation)
        centre = self.scale * self.rotation @ (bounds.centre - self.origin)
        return said | {"box": {"centre": centre.tolist(), "size": (2 * self.scale * bounds.half_extents).tolist()}}

    def as_json(self, gaussians: Gaussians | None = None) -> dict[str, Any]:
        """Return the pose of a file, also as `file_to_scene` (4, 4), and of its Gaussians the box along its axes."""
        return {"file_to_scene": self.matrix().tolist(), **self.pose(gaussians)}


@dataclass(frozen=True)
class PlacingOptions:
    """How files for other programs are turned, moved and scaled."""

    engine: EngineName | None = None
    """Files for this program, in a format that it reads, upright, with the foot at the origin; or a mask for gsplat, or
    all objects as instances. Trims write them beside the others."""
    origin: Origin | None = None
    """What lies at the origin of those files: the middle of the foot, or of the box, or the scene's own origin."""
    scale: Annotated[float, Range(1e-6, 1e6)] = 1.0
    """Units of those files in a unit of the scene, such as 100 for centimetres."""

    def __post_init__(self) -> None:
        if self.engine == "gsplat" and (self.origin or self.scale != 1):
            raise InputError("--for gsplat writes which rows an object has; leave --origin and --scale out.")

    @property
    def wished(self) -> bool:
        """Whether files other than the scene's are asked for."""
        return self != PlacingOptions()

    @property
    def _up(self) -> tuple[float, float, float] | None:
        return None if self.engine is None else ENGINES[self.engine].up

    @property
    def needs_up(self) -> bool:
        """Whether it matters which way is up."""
        return self._up is not None or self.origin in ("foot", "centre")

    def placement(self, gaussians: Gaussians, up: str | Sequence[float] | Float64Array) -> Placement:
        """Return where Gaussians are put: upright for the program, and with a point of them at the origin.

        Args:
            gaussians: N of them, at least one unless the origin is the scene's.
            up: the up vector in their coordinates, (3,), or an axis, "z" or "-y".

        Raises:
            InputError: the up vector is neither an axis nor three finite numbers that are not all zero.
        """
        up = unit_up(vector_of_up(up))
        rotation = np.eye(3) if self._up is None else rotation_between(up, np.array(self._up))
        origin = self.origin or ("scene" if self._up is None else "foot")
        if origin == "scene":
            return Placement(rotation, np.zeros(3), self.scale)
        bounds = _bounds(gaussians, rotation_between(up, np.array([0.0, 0, 1])))
        down = bounds.half_extents[2] if origin == "foot" else 0.0
        return Placement(rotation, bounds.centre - down * bounds.axes[2], self.scale)

    def patterns(self, suffix: str) -> tuple[str, ...]:
        """Return patterns of the names of all files that `write` writes."""
        if not self.wished:
            return ()
        if self.engine == "instances":
            return INSTANCES
        if self.engine == "gsplat":
            return "object.pt", "object_*.pt"
        ending = self._ending(suffix)
        return f"object{ending}", f"object_*{ending}", f"background{ending}", "object*_hull.obj", POSES, STAGE

    def write(self, result: TrimResult, folder: Path, suffix: str, *, background: bool = True) -> list[str]:
        """Write objects and background of a trim into an existing folder; return the names of the files.

        Each object has its own foot at the origin, and a convex hull; the background has the foot of all objects
        together, so that a single object fits it; `poses.json` says where each file lies in the scene. For gsplat there
        is a mask of the scene's rows for each object, and for instances one file of all.

        Args:
            result: the trim.
            folder: where to write.
            suffix: ending of the scene's own files, which those have that are for no program.
            background: write the background too.

        Raises:
            InputError: a file cannot be written, or the format cannot hold the Gaussians.
        """
        from gaussian_trimmer.output.report import file_stems

        parts = [part for part in result.objects if len(part.gaussians)]
        stems = file_stems((part.id, part.name) for part in result.objects)
        if self.engine == "gsplat":
            for part in parts:
                write_mask(mask_of_rows(part.source_index, len(result.scene)), folder / f"{stems[part.id]}.pt")
            return [f"{stems[part.id]}.pt" for part in parts]
        if not parts:
            return []
        up = result.objects[0].up.direction
        whole = self.placement(concatenate([part.gaussians for part in parts]), up)
        wanted = background and not result.nothing_trimmed and len(result.background)
        rest = result.background if wanted else None
        if self.engine == "instances":
            return _write_instances(parts, rest, whole, up, folder)
        ending, poses, stage = self._ending(suffix), dict[str, Any](), list[str]()
        for part in parts:
            place, name = self.placement(part.gaussians, up), f"{stems[part.id]}{ending}"
            placed, hull = place.apply(part.gaussians), f"{stems[part.id]}_hull.obj"
            formats.write(placed, folder / name)
            corners, triangles = convex_hull(placed)
            lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in corners]
            lines += [f"f {i} {j} {k}" for i, j, k in triangles + 1]
            write_whole(folder / hull, "\n".join([*lines, ""]))
            poses[name] = place.as_json(part.gaussians) | {"hull": hull}
            stage.append(object_in_stage(part.id, part.title, name, place.within(whole).matrix(), corners, triangles))
        if rest is not None:
            name = f"background{ending}"
            formats.write(whole.apply(rest), folder / name)
            poses[name] = whole.as_json()
            stage.append(background_in_stage(name))
        write_json({"up": up.tolist(), "files": poses}, folder / POSES)
        if self.engine == "usd":
            write_whole(folder / STAGE, stage_of(stage))
        return [*poses, *([STAGE] if self.engine == "usd" else [])]

    def sentence(self, files: list[str], up: UpVector) -> str:
        """Return what to say of the files that were written."""
        said = f"For {ENGINES[self.engine].name}" if self.engine else "Placed"
        turned = "" if self._up is None else ", upright" if up.is_sure else ", upright if the up vector is right"
        where = f"; {POSES} says where {'they lie' if len(files) > 1 else 'it lies'}"
        return f"{said}{turned}: {', '.join(files)}{'' if self.engine in ('gsplat', 'instances') else where}."

    def check_target(self, target: Path) -> None:
        """Refuse a file that the program does not read.

        Raises:
            InputError: its name has another ending, or the program gets what only a trim knows.
        """
        reads = ENGINES[self.engine].reads if self.engine else ()
        if self.engine and not reads:
            raise InputError(f"--for {self.engine} writes what a trim has found; give it to trim, or leave it out.")
        if reads and not any(formats.is_named(target.name, end) for end in reads):
            raise InputError(
                f"{self.engine} reads {', '.join(reads)}; name the target '{Path(target.stem).stem}{reads[0]}', or "
                "leave --for out."
            )

    def _ending(self, suffix: str) -> str:
        """Return how names of files end."""
        return f"_for_{self.engine}{ENGINES[self.engine].reads[0]}" if self.engine else f"_placed{suffix}"


def _write_instances(
    parts: Sequence[TrimmedObject], rest: Gaussians | None, whole: Placement, up: Float64Array, folder: Path
) -> list[str]:
    """Write all into one PLY with the column `instance_id`, 0 for the rest, and into a JSON what each id is.

    That is its name and number of Gaussians; the pose of the object in the PLY, for one that stands upright, z up, with
    its foot at the origin; and its box along the axes of that pose.
    """
    numbered = [(part.id, part.gaussians) for part in parts] + ([] if rest is None else [(0, rest)])
    columns = [found.replace(extras={_COLUMN: np.full(len(found), number, np.int32)}) for number, found in numbered]
    formats.write(whole.apply(concatenate(columns)), folder / INSTANCES[0], extras=True)
    upright, instances = PlacingOptions("usd"), list[dict[str, Any]]()
    for part in parts:
        pose = upright.placement(part.gaussians, up).within(whole).pose(whole.apply(part.gaussians))
        instances.append({"id": part.id, "name": part.name, "gaussians": len(part.gaussians), **pose})
    document = {"file": INSTANCES[0], "column": _COLUMN, "background": 0, "instances": instances}
    write_json(document, folder / INSTANCES[1])
    return list(INSTANCES)


def _bounds(gaussians: Gaussians, axes: Float64Array) -> Bounds:
    from gaussian_trimmer.geometry.bounds import robust_bounds  # late: conversions seldom need its kernels

    return robust_bounds(gaussians, axes)


def rotation_between(source: Float64Array, target: Float64Array) -> Float64Array:
    """The smallest rotation (3, 3) from one unit vector to another; of opposite ones, half a turn about some axis.

    >>> rotation_between(np.array([0.0, -1, 0]), np.array([0.0, 0, 1])) @ [0, -1, 0]
    array([0., 0., 1.])
    """
    middle = source + target
    if np.linalg.norm(middle) < 1e-9:
        middle = np.cross(source, np.eye(3)[np.argmin(np.abs(source))])
        middle /= np.linalg.norm(middle)
        return np.asarray(2 * np.outer(middle, middle) - np.eye(3))
    # Two reflections: in the plane across the source, then in the one across the middle.
    return np.asarray(
        (np.eye(3) - 2 * np.outer(middle, middle) / (middle @ middle)) @ (np.eye(3) - 2 * np.outer(source, source))
    )


def convex_hull(gaussians: Gaussians) -> tuple[Float64Array, IntArray]:
    """Return corners (C, 3) of a hull around one standard deviation of Gaussians, and its triangles (F, 3), from 0.

    Triangles are counter-clockwise as seen from outside. What is flat gets a hull that is hardly thicker.
    """
    from scipy.spatial import ConvexHull

    points = ellipsoid_points(gaussians).reshape(-1, 3)
    height = 1 - (2 * np.arange(_CORNERS) + 1) / _CORNERS
    turn, side = np.pi * (1 + 5**0.5) * np.arange(_CORNERS), np.sqrt(1 - height**2)
    directions = np.stack([side * np.cos(turn), side * np.sin(turn), height], axis=1)
    corners = points[np.unique([int(np.argmax(points @ direction)) for direction in directions])]
    hull = ConvexHull(corners, qhull_options="QJ")  # joggled: what is flat has a hull, too
    a, b, c = corners[hull.simplices].swapaxes(0, 1)
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    return corners, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
