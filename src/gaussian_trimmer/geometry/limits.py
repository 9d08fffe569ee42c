"""Which numbers a scene may hold: those that the stages can square and add up in single precision."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.io.reading import LARGEST

LARGEST_LOG_SCALE = 80.0
"""Greatest log scale of a scene; standard deviations a few thousand times larger are no float32."""
SMALLEST_SCENE = 1e-15
"""Least extent of a scene, in its units."""
_LARGEST_NUMBER = float(np.finfo(np.float32).max)
_LIMITS = {
    "means": (-LARGEST, LARGEST, "coordinates up to 1e15 can be used; remove such Gaussians, or scale the scene down"),
    "log_scales": (-_LARGEST_NUMBER, LARGEST_LOG_SCALE, "finite ones up to 80 can be used; remove such Gaussians, or "
                   "scale the scene down"),
    "opacity_logits": (-np.inf, np.inf, "remove such Gaussians"),
}  # fmt: skip
"""Attribute -> least and largest value, and what to do about others. Opacities may be exactly zero and one."""
_SHORTEST, _LONGEST = 1e-12, 1e12
"""Lengths of quaternions that can be squared."""


def check_magnitudes(scene: Gaussians) -> None:
    """Refuse a scene with which nothing can be computed, before any work is done.

    Raises:
        InputError: a centre, a scale, an opacity or a rotation is NaN or out of its range, or the whole scene is too
            small; the message names the attribute and the first row.
    """
    if not len(scene):
        return
    for name, (low, high, cure) in _LIMITS.items():
        values: FloatArray = getattr(scene, name).reshape(len(scene), -1)
        if not (values.min() >= low and values.max() <= high):  # neither is true of NaN
            _refuse(name, np.asarray(((values >= low) & (values <= high)).all(axis=1)), values, cure)
    lengths = np.sqrt(np.einsum("ni,ni->n", scene.quaternions, scene.quaternions, dtype=np.float64))
    if not (lengths.min() >= _SHORTEST and lengths.max() <= _LONGEST):
        cure = f"lengths from {_SHORTEST:g} to {_LONGEST:g} can be used; bring the quaternions to length one"
        _refuse("quaternions", (lengths >= _SHORTEST) & (lengths <= _LONGEST), scene.quaternions, cure)
    size = max(float(np.ptp(scene.means, axis=0).max()), float(np.exp(scene.log_scales.max())))
    if size < SMALLEST_SCENE:
        raise InputError(f"The whole scene is {size:.3g} units large; scale it up, to {SMALLEST_SCENE:g} at the least.")


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


def _refuse(name: str, sound: BoolArray, values: FloatArray, cure: str) -> None:
    row = int(np.argmin(sound))
    first = ", ".join(f"{value:.4g}" for value in values[row])
    raise InputError(
        f"{np.count_nonzero(~sound):,} of {len(sound):,} Gaussians have {name} that cannot be used, the first in row "
        f"{row} ({first}): {cure}."
    )
