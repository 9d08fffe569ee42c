"""The up vector of a scene: given, stated in the camera file, or found from the cameras or from the ground plane."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gaussian_trimmer.cameras import Camera, CameraSet, unit_up, vector_of_up
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, sigmoid
from gaussian_trimmer.geometry.planes import Plane, fit_plane, inlier_shares, median_radius, random_planes
from gaussian_trimmer.geometry.storey import MIN_FLOOR, find_storey, sampled

DEFAULT_UP = (0.0, -1.0, 0.0)
"""Up if nothing else is known: the first OpenCV camera of a reconstruction is usually upright."""

SURE_CONFIDENCE = 0.4
"""Confidence from which up is not called a guess. Floors have 0.15 to 0.5, planes that are none up to 0.25."""
FROM_FORMAT = "file format"
_FORMAT_CONFIDENCE = 0.5
"""Converters copy numbers whatever a format's specification says."""

# Cameras
_MIN_TURN = 0.01
"""Smallest mean square of the right axes along their second principal direction that is no noise (6 degrees)."""
_MAX_ROLL = 0.05
"""Largest scatter of the right axes out of their plane, relative to that turn."""
_MIN_AGREEMENT = 0.5
"""Smallest length of the mean of the cameras' unit up axes at which it is used."""

# Layers
_MIN_LEAD = 0.6
"""Confidence, one less the area of the largest level layer along another axis relative to it, from which on one is a
floor."""

# Ground plane
_SAMPLE_SIZE = 20_000
_SCORED_POINTS = 4_000
_OBJECT_SAMPLE_SIZE = 1_000
_HYPOTHESES, GROUND_TRIES = 2_000, 400
"""Planes that are tried, the second number for a ground which is only to be compared with up."""
_PLANES_AT_ONCE = 64
_POINTS_AT_ONCE = 1 << 14
_MOST_CANDIDATES = 20 * _SAMPLE_SIZE
"""Gaussians that a sample is drawn from, at most: every n-th of more."""
_THICKNESS_RADII = 0.01
"""Distance of inliers from the plane, relative to the robust radius of what is searched."""
_REACHES_RADII = (3.0, 6.0, 12.0, np.inf)
"""The object's support plane is searched within so many robust radii of it, farther out only if there is none nearer:
below a part of an object there is none."""
_MIN_SHARE = 0.15
"""Smallest share of inliers: clouds without a plane reach 0.1 by chance."""
_MIN_NEAR_SHARE, _MIN_SLANTED_SHARE = 0.2, 0.3
"""The same close to the object, where farther ones may be better, and farther out for planes that do not lie along the
axes, where more is no ground."""
_LYING_DISTANCE_RADII = 0.1
"""Median distance from the plane, in robust radii of the object, up to which an object lies in it: a rug, a board."""
_MIN_POINTS = 50
_AXIS_BONUS = 1.25
_AXIS_COSINE = np.cos(np.radians(20))


@dataclass(frozen=True, eq=False)
class UpVector:
    """Which way is up, and how that is known."""

    direction: Float64Array
    """Unit vector in the world, (3,)."""
    source: str
    """One of: given, found before, camera file, camera axes, mean camera up, ground plane, floor, file format,
    default."""
    confidence: float
    """From 0 (a guess) to 1: agreement of the cameras, or share of the Gaussians that lie on the plane, or on two
    planes that agree."""

    @property
    def is_sure(self) -> bool:
        """Whether it need not be looked at."""
        return self.confidence >= SURE_CONFIDENCE

    def for_trims(self) -> tuple[float, ...] | None:
        """Return what trims of the scene are given, with the confidence of what was found.

        None if it is a guess, or if the cameras tell it again.
        """
        if not self.is_sure or self.source in ("camera file", "camera axes"):
            return None
        return vector_of_up([*self.direction, *([] if self.source == "given" else [round(self.confidence, 3)])])

    def doubt(self) -> str | None:
        """Return what to do if it is little more than a guess, a sentence: the opposite is the usual truth.

        >>> UpVector(np.array([0.0, -1, 0]), "default", 0.0).doubt()
        'The up vector is a guess. If the views are upside down, give --up y; if they are tilted, try another axis.'
        """
        if self.is_sure:
            return None
        axis = int(np.argmax(np.abs(self.direction)))
        sign = "-" if self.direction[axis] > 0 else ""
        return (
            f"The up vector is a guess. If the views are upside down, give --up {sign}{'xyz'[axis]}; if they are "
            "tilted, try another axis."
        )


def up_text(direction: Iterable[float], source: str, confidence: float) -> str:
    """Return an up vector and how it is known, as people read it.

    >>> up_text([0, -1e-9, 1], "floor", 0.5)
    '0.000 0.000 1.000 (floor, confidence 0.50)'
    """
    numbers = " ".join(f"{round(value, 3) + 0.0:.3f}" for value in direction)  # not -0.000
    return f"{numbers} ({source}, confidence {confidence:.2f})"


KNOWN_SOURCES = ("given", "camera file", "camera axes")
"""Where up vectors come from that a ground plane can contradict; other sources are the plane, or worse than it."""


def find_up(
    gaussians: Gaussians,
    cameras: CameraSet | None = None,
    given: str | Sequence[float] | Float64Array | UpVector | None = None,
    object_rows: BoolArray | None = None,
) -> UpVector:
    """Return the up vector from the best source there is.

    In order of preference: the given vector, the one that the camera file states, the cameras' axes, the plane that the
    scene or the object stands on, the axis along which the floor of a room lies, what the file's format says, and -y
    with confidence 0.

    Args:
        given: any non-zero vector (3,), an axis, "z" or "-y", or what was found before, also as a vector and its
            confidence, (4,).
        object_rows: the Gaussians of the object, (N,), whose support plane is then searched.

    Raises:
        InputError: the given vector is neither an axis nor three finite numbers that are not all zero.
    """
    if isinstance(given, UpVector):
        return given
    if given is not None:
        x, y, z, *confidence = vector_of_up(given)
        return UpVector(unit_up((x, y, z)), "found before" if confidence else "given", *confidence or (1.0,))
    if cameras is not None and cameras.up is not None:
        return UpVector(unit_up(cameras.up), "camera file", 1.0)
    found = up_from_cameras(cameras.cameras) if cameras is not None else None
    found = found or _up_from_ground(gaussians, object_rows)
    if found is not None and not found.is_sure and object_rows is not None:
        found = _confirmed(found, gaussians)
    found = found or up_from_layers(gaussians)
    if found is None and gaussians.format_up is not None:
        return UpVector(unit_up(gaussians.format_up), FROM_FORMAT, _FORMAT_CONFIDENCE)
    return found or UpVector(np.array(DEFAULT_UP), "default", 0.0)


def _up_from_ground(gaussians: Gaussians, object_rows: BoolArray | None) -> UpVector | None:
    """Do as `up_from_ground_plane`, but for ceilings of rooms, as the furniture tells, and walls with a picture."""
    found = up_from_ground_plane(gaussians, object_rows)
    if found is None:
        return None
    if object_rows is None:
        storey = find_storey(sampled(gaussians), found.direction)
        return replace(found, direction=-found.direction) if storey.is_room and not storey.is_upright else found
    if _is_flat(gaussians.means[object_rows], found.direction):
        floor = up_from_layers(gaussians)
        return found if floor is None or floor.direction @ found.direction > _AXIS_COSINE else floor
    return found


def _confirmed(found: UpVector, scene: Gaussians) -> UpVector:
    """Return an up vector, with more confidence where the ground of the whole scene says the same."""
    whole = up_from_ground_plane(scene, None, GROUND_TRIES)
    if whole is None or found.direction @ whole.direction < _AXIS_COSINE:
        return found
    return replace(found, confidence=min(1.0, found.confidence + whole.confidence))


def up_from_cameras(cameras: Sequence[Camera]) -> UpVector | None:
    """Return the direction in which the cameras were held upright, or None where they do not agree on one.

    Cameras that turn about the vertical keep their right axes level, whatever their pitch, so the direction in which
    the right axes vary least is up. That holds on a part of an orbit too, where the mean of the up axes leans towards
    the side that the cameras look from. Cameras that hardly turn leave that direction undetermined, and those that
    were rolled have no level axes; for both the mean up axis is taken, which is off by their mean pitch.
    """
    axes = np.array([camera.rotation for camera in cameras])  # (V, 3, 3), rows right, down, forward
    mean_up, mean_forward = -axes[:, 1].mean(axis=0), axes[:, 2].mean(axis=0)
    agreement = float(np.linalg.norm(mean_up))

    spread, directions = np.linalg.eigh(axes[:, 0].T @ axes[:, 0] / len(axes))
    if spread[1] > _MIN_TURN and spread[0] < _MAX_ROLL * spread[1]:
        direction = directions[:, 0]
        # Cameras that look straight down have no mean up; they look down.
        side = direction @ (mean_up if abs(direction @ mean_up) > 0.1 else -mean_forward)
        roll = np.sqrt(max(spread[0], 0.0) / spread[1])
        return UpVector(direction * (1.0 if side >= 0 else -1.0), "camera axes", float(1.0 - roll))
    if agreement >= _MIN_AGREEMENT:
        # A camera always agrees with itself, so a single one is no more than a guess.
        return UpVector(mean_up / agreement, "mean camera up", agreement * (1 - 1 / len(axes)))
    return None


def up_from_layers(gaussians: Gaussians) -> UpVector | None:
    """Return the axis along which flat level Gaussians cover by far the largest area in one layer, or None.

    Walls are many and narrow, a floor is one and wide, however few Gaussians it has. Below a ceiling, the floor is the
    end that tables and seats are near; without one, more lies above it.
    """
    sample = sampled(gaussians)
    found = [find_storey(sample, axis) for axis in np.eye(3)]
    areas = np.array([storey.area for storey in found])
    best = int(np.argmax(areas))
    lead = 1 - float(np.delete(areas, best).max() / max(areas[best], 1e-30))
    if lead < _MIN_LEAD or found[best].share < MIN_FLOOR:
        return None
    return UpVector(np.eye(3)[best] * (1.0 if found[best].is_upright else -1.0), "floor", lead)


def up_from_ground_plane(
    gaussians: Gaussians, object_rows: BoolArray | None = None, tries: int = _HYPOTHESES
) -> UpVector | None:
    """Return the normal of the plane that most Gaussians lie on, towards what stands on it; None where there is none.

    RANSAC of so many tries over at most 20 000 centres drawn by opacity, then least squares on the inliers; the same
    every time. With `object_rows` (N,) the object's surroundings are searched, at first the nearest ones, and planes
    that touch it from one side are preferred; without, or if it lies in the plane, the side with more Gaussians is up.
    """
    rng, everything = np.random.default_rng(0), np.ones(len(gaussians), np.bool_)
    if object_rows is None or not object_rows.any():
        return _up_from_points(
            _draw(gaussians, everything, _SAMPLE_SIZE, rng), None, _MIN_SHARE, _MIN_NEAR_SHARE, rng, tries
        )
    object_points = _draw(gaussians, object_rows, _OBJECT_SAMPLE_SIZE, rng)
    distances, searched = _distances(gaussians.means, np.median(object_points, axis=0)), 0
    radius = float(np.quantile(distances[object_rows], 0.9))
    for reach in _REACHES_RADII:
        near = ~object_rows & (distances < reach * radius)
        if not near.any() or np.count_nonzero(near) == searched:
            continue
        least = (_MIN_NEAR_SHARE, _MIN_NEAR_SHARE) if reach == _REACHES_RADII[0] else (_MIN_SHARE, _MIN_SLANTED_SHARE)
        found = _up_from_points(_draw(gaussians, near, _SAMPLE_SIZE, rng), object_points, *least, rng, tries)
        if found is not None and (
            found.confidence >= _MIN_SLANTED_SHARE or _is_plausible(found.direction, gaussians, tries)
        ):
            return found
        searched = int(np.count_nonzero(near))
    if object_rows.all():
        return None
    # The object may be the ground itself.
    return _up_from_points(
        _draw(gaussians, everything, _SAMPLE_SIZE, rng), None, _MIN_SHARE, _MIN_SLANTED_SHARE, rng, tries
    )


def _is_plausible(up: Float64Array, scene: Gaussians, tries: int) -> bool:
    """Tell whether a small plane may be the ground: it lies along the axes, or as the plane of the whole scene."""
    if _along_axis(up[None])[0]:
        return True
    whole = up_from_ground_plane(scene, None, tries)
    return whole is not None and bool(abs(up @ whole.direction) > _AXIS_COSINE)


def _up_from_points(
    points: Float64Array,
    object_points: Float64Array | None,
    min_share: float,
    min_slanted_share: float,
    rng: np.random.Generator,
    tries: int,
) -> UpVector | None:
    """Return the normal of the plane that most points lie on, if enough do."""
    if len(points) < _MIN_POINTS:
        return None
    tolerance = _THICKNESS_RADII * median_radius(points)
    plane = _best_plane(points, object_points, tolerance, rng, tries) if tolerance > 0 else None
    if plane is None:
        return None
    plane = fit_plane(plane, points, np.ones(len(points)), tolerance)
    heights = plane.signed_distance(points)
    share = float((abs(heights) < tolerance).mean())
    if share < (min_share if _along_axis(plane.normal[None])[0] else min_slanted_share):
        return None
    up = plane.normal if _stands_above(plane, heights[abs(heights) >= tolerance], object_points) else -plane.normal
    return UpVector(up, "ground plane", share)


def _stands_above(plane: Plane, others: Float64Array, object_points: Float64Array | None) -> bool:
    """Tell whether the object, or most others if it lies in the plane, stand on the side of the plane's normal.

    Args:
        others: heights of those points that are not in the plane, (P,).
    """
    heights = others
    if object_points is not None:
        standing = plane.signed_distance(object_points)
        if np.median(abs(standing)) > _LYING_DISTANCE_RADII * median_radius(object_points):
            heights = standing
    return bool((heights > 0).sum() >= (heights < 0).sum())


def _is_flat(points: FloatArray, direction: Float64Array) -> bool:
    """Tell whether an object is as flat along a direction as a rug on its floor, or a picture on its wall."""
    heights = points @ direction
    limit = _LYING_DISTANCE_RADII * median_radius(points.astype(np.float64))
    return bool(np.median(np.abs(heights - np.median(heights))) < limit)


def _along_axis(normals: Float64Array) -> BoolArray:
    """Return which normals (P, 3) lie along y or z, as up does in nearly all tools, (P,)."""
    return np.asarray(abs(normals[:, 1:]).max(axis=1) > _AXIS_COSINE)


def _draw(gaussians: Gaussians, rows: BoolArray, size: int, rng: np.random.Generator) -> Float64Array:
    """Return centres of at most `size` of the Gaussians in `rows`, drawn by opacity, in random order, (M, 3)."""
    candidates = np.flatnonzero(rows)
    candidates = candidates[:: 1 + len(candidates) // _MOST_CANDIDATES]
    weights = sigmoid(gaussians.opacity_logits[candidates]).astype(np.float64) + 1e-6
    size = min(size, len(candidates))
    chosen = rng.choice(candidates, size, replace=False, p=weights / weights.sum()) if size else candidates
    return np.asarray(gaussians.means[chosen], np.float64)


def _distances(points: FloatArray, centre: Float64Array) -> Float64Array:
    """Return the distance of each point from a centre, (N,); in parts that fit into the processor's cache."""
    distances = np.empty(len(points))
    for start in range(0, len(points), _POINTS_AT_ONCE):
        part = slice(start, start + _POINTS_AT_ONCE)
        x, y, z = (points[part] - centre).T
        np.sqrt(x * x + y * y + z * z, out=distances[part])
    return distances


def _best_plane(
    points: Float64Array, object_points: Float64Array | None, tolerance: float, rng: np.random.Generator, tries: int
) -> Plane | None:
    """Return the plane of highest score among random ones, or None where all points lie in a line.

    A score is at most the share of inliers, with its bonus, so the planes are scored in falling order of that until
    none can win.
    """
    normals, offsets = random_planes(points, tries, tolerance**2, rng)
    if len(normals) == 0:
        return None
    # Up is stored along -y, +y or +z by nearly all tools and along x by none: this decides between floor and wall.
    bonus = np.where(_along_axis(normals), _AXIS_BONUS, 1.0)
    shares = bonus * inlier_shares(normals, offsets, points[:_SCORED_POINTS], tolerance)
    order = np.argsort(-shares, kind="stable")
    best, highest = int(order[0]), -1.0
    for start in range(0, len(order), _PLANES_AT_ONCE):
        rows = order[start : start + _PLANES_AT_ONCE]
        if shares[rows[0]] <= highest:
            break
        scores = shares[rows]
        if object_points is not None:
            scores = scores * _standing(normals[rows], offsets[rows], object_points, tolerance)
        if scores.max() > highest:
            best, highest = int(rows[np.argmax(scores)]), float(scores.max())
    return Plane(normals[best], float(offsets[best]))


def _standing(
    normals: Float64Array, offsets: Float64Array, object_points: Float64Array, tolerance: float
) -> Float64Array:
    """Return how far an object stands on each plane, (P,): 1 if wholly on one side and touching, else towards 0."""
    heights = normals @ object_points.T - offsets[:, None]  # (P, M)
    heights *= np.where(np.median(heights, axis=1) < 0, -1, 1)[:, None]
    on_one_side = (heights > -tolerance).mean(axis=1)
    gap = np.maximum(0.0, np.quantile(heights, 0.05, axis=1)) / max(median_radius(object_points), tolerance)
    return np.asarray(on_one_side / (1.0 + gap))
