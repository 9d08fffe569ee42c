"""Limits of the numbers that a scene may hold: those that the stages can square and add up in single precision."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.storey import sampled
from gaussian_trimmer.io.reading import LARGEST

LARGEST_LOG_SCALE = 80.0
"""Greatest log scale of a scene; standard deviations a few thousand times larger do not fit in a float32."""
SMALLEST_SCENE = 1e-15
"""Least extent of a scene, in its units."""
_MAX_STEP_WIDTHS = 0.5
"""Step between single-precision coordinates, in widths of a Gaussian, from which on places are lost."""
_LARGEST_FLOAT = float(np.finfo(np.float32).max)
_RANGES_BY_FIELD = {
    "means": (-LARGEST, LARGEST),
    "log_scales": (-_LARGEST_FLOAT, LARGEST_LOG_SCALE),
    "opacity_logits": (-np.inf, np.inf),
    "sh_dc": (-LARGEST, LARGEST),
    "sh_rest": (-LARGEST, LARGEST),
}
"""Attribute -> least and largest value. Opacities may be exactly zero and one."""
_SHORTEST_QUATERNION, _LONGEST_QUATERNION = 1e-12, 1e12
"""Lengths that can be squared."""
_ROWS_AT_ONCE = 1 << 12


def check_values(gaussians: Gaussians, where: str = "") -> None:
    """Refuse values with which nothing can be computed: NaN, infinities, extreme magnitudes, lengths of zero.

    Looks at a megabyte of rows at a time: of a PLY, the attributes are views of one table, whose rows interleave them.

    Args:
        gaussians: any number of them.
        where: what the message begins with.

    Raises:
        InputError: there is one; the message names the attribute and the first row, and counts all of them.
    """
    if _unusable(gaussians).any():
        raise InputError(f"{where}{_describe(gaussians)}: remove such Gaussians, or scale the scene.")


def blank_unusable(gaussians: Gaussians, where: str = "") -> Gaussians:
    """Replace rows of values with which nothing can be computed by invisible copies of others, spread over the scene.

    So all rows keep their numbers, and nothing else that looks at the scene needs to know. Extra columns stay.

    Raises:
        InputError: as for `check_values`, where no row can be used.
    """
    unusable = _unusable(gaussians)
    if not unusable.any():
        return gaussians
    if unusable.all():
        check_values(gaussians, where)
    rows, usable = np.arange(len(gaussians)), np.flatnonzero(~unusable)
    rows[unusable] = usable[np.linspace(0, len(usable) - 1, np.count_nonzero(unusable)).astype(np.int64)]
    copies = gaussians.select(rows)
    note = f"{_describe(gaussians)}: they are left out of pictures and results, and row numbers stay as in the file"
    return copies.replace(
        opacity_logits=np.where(unusable, -np.inf, copies.opacity_logits),
        extras=gaussians.extras,
        notes=(*gaussians.notes, note),
    )


def _unusable(gaussians: Gaussians) -> BoolArray:
    """Return which rows have values that cannot be used, (N,)."""
    unusable = np.zeros(len(gaussians), np.bool_)
    for start in range(0, len(gaussians), _ROWS_AT_ONCE):
        part = slice(start, start + _ROWS_AT_ONCE)
        for _, sound, _ in _unsound(gaussians.select(part)):
            unusable[part] |= ~sound
    return unusable


def _describe(gaussians: Gaussians) -> str:
    """Return a clause on values of which some cannot be used."""
    name, sound, allowed = next(_unsound(gaussians))
    row, number = int(np.argmin(sound)), np.count_nonzero(_unusable(gaussians))
    first = ", ".join(f"{value:.4g}" for value in np.atleast_1d(getattr(gaussians, name)[row]).ravel()[:4])
    return (
        f"{number:,} of {len(sound):,} Gaussians have {name} that cannot be used, the first in row {row} ({first}); "
        f"{allowed} can be"
    )


@np.errstate(invalid="ignore", over="ignore")
def _unsound(gaussians: Gaussians) -> Iterator[tuple[str, BoolArray, str]]:
    """Yield attributes with values that cannot be used, which rows have others, (N,), and what can be used."""
    for name, (low, high) in _RANGES_BY_FIELD.items():
        values: FloatArray = getattr(gaussians, name).reshape(len(gaussians), -1)
        if values.size and not (values.min() >= low and values.max() <= high):  # neither is true of NaN
            sound = np.asarray(((values >= low) & (values <= high)).all(axis=1))
            yield name, sound, f"finite values from {low:.3g} to {high:.3g}"
    squares = np.einsum("ni,ni->n", gaussians.quaternions, gaussians.quaternions)
    sound = np.asarray((squares >= _SHORTEST_QUATERNION**2) & (squares <= _LONGEST_QUATERNION**2))
    if not sound.all():
        yield "quaternions", sound, f"lengths from {_SHORTEST_QUATERNION:g} to {_LONGEST_QUATERNION:g}"


def check_magnitudes(scene: Gaussians) -> None:
    """Refuse a scene with which nothing can be computed, before any work is done.

    Raises:
        InputError: as for `check_values`, or the whole scene is too small.
    """
    if not len(scene):
        return
    check_values(scene)
    size = max(max(float(np.ptp(axis)) for axis in scene.means.T), float(np.exp(scene.log_scales.max())))
    if size < SMALLEST_SCENE:
        raise InputError(f"The whole scene is {size:.3g} units large; scale it up, to at least {SMALLEST_SCENE:g}.")


def lost_places(scene: Gaussians) -> str | None:
    """Say what single precision has made of coordinates as those of maps, which have their origin far away.

    Args:
        scene: N Gaussians.

    Returns:
        A clause without a full stop; None where the coordinates tell the Gaussians apart.
    """
    sample = sampled(scene)
    middle = np.median(sample.means, axis=0)
    step = float(np.spacing(np.abs(middle).max()))
    width = float(np.exp(np.median(sample.largest_log_scales)))
    if step <= _MAX_STEP_WIDTHS * width:
        return None
    place = " ".join(f"{value:.0f}" for value in middle)
    return (
        f"the Gaussians lie around {place}, where coordinates in single precision are {step:.3g} apart, and are "
        f"themselves only {width:.3g} wide; move the origin into the scene, by subtracting such a place from "
        "double-precision coordinates of Gaussians and cameras before they are stored"
    )


def check_places(scene: Gaussians) -> None:
    """Refuse a scene of which single precision has lost most.

    Raises:
        InputError: as `lost_places` says it.
    """
    if len(scene) and (lost := lost_places(scene)):
        raise InputError(f"The scene cannot be told apart: {lost}.")


def check_size(radius: float) -> None:
    """Refuse an object whose size, in scene units, cannot be computed with.

    Raises:
        InputError: it is too small or too large.
    """
    if not SMALLEST_SCENE / 10 <= radius <= 10 * LARGEST:
        raise InputError(
            f"The selected object is {2 * radius:.3g} units large, by where most of its Gaussians lie and how large "
            f"they are; {SMALLEST_SCENE:g} to {LARGEST:g} can be used: select others, or scale the scene."
        )
