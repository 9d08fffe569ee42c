"""Inputs that are wrong although each of them can be read: said before any work is done with them.

A selection of another file, or of the same Gaussians in another order, still has the right length; cameras of another
scene are cameras; and coordinates of a map are numbers. Trimmed all the same, they give an object that nobody wanted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.geometry.limits import lost_places
from gaussian_trimmer.geometry.planes import median_radius
from gaussian_trimmer.geometry.storey import find_storey, sampled
from gaussian_trimmer.trimming.up_vector import GROUND_TRIES, UpVector, up_from_ground_plane
from gaussian_trimmer.views.virtual_cameras import cameras_that_see

_NEIGHBOURS = 8
_SAMPLE_SIZE = 500
"""Selected Gaussians whose neighbours are looked at, spread over the selection."""
_SCENE_SAMPLE_SIZE = 20_000
_MIN_SELECTED = 100
"""Selected Gaussians that a sample of the scene holds at the least, if there are so many."""
_MIN_JUDGED = 20
"""Fewer selected Gaussians than this can lie anywhere."""
_MIN_AGREEMENT = 0.3
"""Agreement of neighbours below which a selection is no object. Of selections of objects, thin and broken ones among
them, the least is 0.58; rows in another order, also where both orders follow the space, reach 0.2."""
_MOST_OF_SCENE = 0.5
"""Share of a scene's Gaussians from which on a selection may be the background by mistake."""
_LARGEST_REST = 0.5
"""Spread of the rest, relative to that of the selection, up to which the rest may be the object. Those of the benchmark
have at most a quarter of their surroundings'."""
_MAX_TILT_DEGREES = 30.0
_MIN_FLOOR = 0.4
"""Smallest area of a level layer, relative to an upright one, which makes that a wall and not the ground."""
_MIN_GROUND_CONFIDENCE = 0.2
"""Confidence in a ground plane from which on it can disagree with an up vector."""


def find_wrong_input(scene: Gaussians, selection: BoolArray, bounds: Bounds, cameras: Sequence[Camera]) -> str | None:
    """Say why the object cannot be trimmed with what was given, a clause without a full stop; None if it can.

    Args:
        scene: all N Gaussians.
        selection: the selected object, (N,).
        bounds: its bounds.
        cameras: the training cameras, if known.
    """
    if np.count_nonzero(selection) == 1:
        return "a single Gaussian is selected, which has no outline that others make; select all those of the object"
    return lost_places(scene.select(selection)) or _scatter(scene, selection) or _blind_cameras(cameras, bounds)


def selection_warning(scene: Gaussians, selection: BoolArray) -> str | None:
    """Return what speaks against a selection (N,) of most of a scene, a sentence; None if nothing does.

    A capture of little but the object is mostly selected, too, but then what is left is next to nothing or lies around
    it.
    """
    share = float(selection.mean())
    if share <= _MOST_OF_SCENE:
        return None
    if (selection | scene.blank).all():
        return "The object is the whole file, so the scene without it is empty. To cut out a part, select that part."
    rest = scene.means[~selection]
    if len(rest) < _MIN_JUDGED or median_radius(rest) > _LARGEST_REST * median_radius(scene.means[selection]):
        return None
    return (
        f"The selection holds {100 * share:.0f} % of the scene's Gaussians, and what it leaves out lies together. If "
        "that is the object, select it instead."
    )


def up_warning(scene: Gaussians, selection: BoolArray, up: UpVector) -> str | None:
    """Return what speaks against an up vector that cameras tell, a sentence; None if nothing does, or if it was stated.

    A scene may have been turned after its cameras were saved.

    Args:
        scene: all N Gaussians.
        selection: the selected object, (N,).
        up: the vector, and how it is known.
    """
    if up.source != "camera axes":
        return None
    ground = up_from_ground_plane(scene, selection, GROUND_TRIES)
    if ground is None or ground.confidence < _MIN_GROUND_CONFIDENCE:
        return None
    tilt = np.degrees(np.arccos(np.clip(up.direction @ ground.direction, -1, 1)))
    if tilt <= _MAX_TILT_DEGREES or (abs(90 - tilt) < _MAX_TILT_DEGREES and _has_floor(scene, up, ground)):
        return None
    given, found = (
        " ".join(f"{value + 0.0:.2f}" for value in np.round(v, 2)) for v in (up.direction, ground.direction)
    )
    return (
        f"The up vector {given} ({up.source}) is {tilt:.0f} degrees away from that of the plane which the object "
        f"stands on; if the views are tilted, give --up {found}."
    )


def _has_floor(scene: Gaussians, up: UpVector, wall: UpVector) -> bool:
    """Return whether something level is nearly as wide as an upright plane: then the plane is a wall."""
    sample = sampled(scene)
    level, upright = (find_storey(sample, one.direction).area for one in (up, wall))
    return level > _MIN_FLOOR * upright


def neighbour_agreement(scene: Gaussians, selection: BoolArray) -> float:
    """Return how much more often the neighbours of a selected Gaussian are selected than any Gaussian is.

    1 where all of them are, 0 where they are no more often than by chance. Judged on a sample, the same every time.

    Args:
        scene: N Gaussians, not all of them selected.
        selection: the selected object, (N,).
    """
    step = max(1, min(len(scene) // _SCENE_SAMPLE_SIZE, int(selection.sum()) // _MIN_SELECTED))
    # Every n-th of either side, so that an order of rows in which every n-th is selected does no harm.
    rows = np.sort(np.concatenate([np.flatnonzero(selection)[::step], np.flatnonzero(~selection)[::step]]))
    means, chosen = scene.means[rows], selection[rows]
    asked = np.flatnonzero(chosen)
    asked = asked[np.linspace(0, len(asked) - 1, min(_SAMPLE_SIZE, len(asked))).astype(np.int64)]
    _, near = nearest(means, means[asked], min(_NEIGHBOURS + 1, len(means)))
    others = near != asked[:, None]
    share, chance = np.count_nonzero(chosen[near] & others) / np.count_nonzero(others), float(chosen.mean())
    return (share - chance) / (1 - chance)


def _scatter(scene: Gaussians, selection: BoolArray) -> str | None:
    if (selection | scene.blank).all() or selection.sum() < _MIN_JUDGED or len(scene) <= 2 * _NEIGHBOURS:
        return None
    agreement = neighbour_agreement(scene, selection)
    if agreement >= _MIN_AGREEMENT:
        return None
    return (
        f"the {selection.sum():,} selected Gaussians are scattered over the scene (neighbours agree by "
        f"{agreement:.2f}, where 1 is a solid object and 0 is chance), as when a selection was made for the same "
        "Gaussians in another order of rows; give the very file that it was made for"
    )


def _blind_cameras(cameras: Sequence[Camera], bounds: Bounds) -> str | None:
    if not cameras or cameras_that_see(cameras, bounds):
        return None
    centre = " ".join(f"{value:.4g}" for value in bounds.centre)
    return (
        f"none of the {len(cameras)} training cameras has the object, around {centre}, in its picture; give the "
        "cameras of this scene in the scene's own coordinates, or leave them out"
    )
