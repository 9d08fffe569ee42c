"""The surface that an object stands on.

Table tops and floors are where rough selections go wrong most, and they are easy to know: a horizontal layer that
holds much of what surrounds the object. Once it is set aside, what stands on it falls apart into pieces that do not
touch. A piece that mostly belongs to the selection belongs to it whole: an arm in the table's colour, a leaf that the
selection missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.settings import Range, Share

_REACH = 1.5
_SEARCHED = 0.4
_BIN = 0.02
_OBJECT_FOOT = 0.02


@dataclass(frozen=True)
class SupportConfig:
    """How the supporting surface helps to correct labels."""

    enabled: bool = True
    """Look for the surface; where there is none, nothing changes."""
    least_share: Share = 0.3
    """Smallest share that the layer must hold of the visible surroundings about the height of the object's foot. What
    lies far below, like the ground around a plinth, and far above, like walls, does not count."""
    least_share_of_all: Share = 0.1
    """Smallest share that it must hold of all visible surroundings: a wisp is no surface."""
    thickness: Annotated[float, Range(1e-3, 10)] = 0.05
    """Half of the layer's thickness, relative to the object's radius."""
    gap: Annotated[float, Range(1e-3, 10)] = 0.1
    """Largest distance between neighbours in one piece of what stands on the surface, in object radii."""
    gap_spacing: Annotated[float, Range(0, 100)] = 2.8
    """The same in median distances between nearest neighbours of the selection, if that is more: few large Gaussians
    touch each other though their centres lie far apart."""
    least_selected: Share = 0.5
    """Smallest selected share of a piece that is taken to be the object."""


@dataclass(frozen=True, eq=False)
class Support:
    """Where each Gaussian lies relative to the surface."""

    height: float
    """Height of the surface above the bounds' centre, in object radii."""
    thickness: float
    """Half the thickness of its layer, in object radii."""
    on_surface: BoolArray
    """Gaussians of the layer, (N,)."""
    above: BoolArray
    """Gaussians above it, (N,)."""


def find_support(
    places: FloatArray, selection: BoolArray, weights: Float64Array, bounds: Bounds, config: SupportConfig
) -> Support | None:
    """The horizontal layer near the object's foot that holds most of its visible surroundings; None if there is none.

    Args:
        places: centres divided by the object's radius, (N, 3).
        selection: the coarse labels, (N,).
        weights: how much each Gaussian is visible, (N,).
        bounds: the object's bounds: their third axis is up.
        config: what counts as a surface.
    """
    local = (places - bounds.centre / bounds.radius) @ bounds.axes.T
    height = local[:, 2]
    around = ~selection & (np.hypot(local[:, 0], local[:, 1]) < _REACH)
    total = weights[around].sum()
    if not config.enabled or total <= 0 or not selection.any():
        return None
    foot = np.quantile(height[selection], _OBJECT_FOOT)
    edges = np.arange(foot - _SEARCHED, foot + _SEARCHED + _BIN, _BIN)
    counts = np.convolve(np.histogram(height[around], edges, weights=weights[around])[0], [1, 1, 1], "same")
    best = int(np.argmax(counts))
    level = weights[around & (np.abs(height - foot) < _SEARCHED)].sum()
    if counts[best] < max(config.least_share * level, config.least_share_of_all * total, 1e-12):
        return None
    middle = edges[best] + _BIN / 2
    layer = around & (np.abs(height - middle) < 1.5 * _BIN)
    middle = np.average(height[layer], weights=weights[layer])
    on_surface, above = np.abs(height - middle) <= config.thickness, height > middle + config.thickness
    return Support(float(middle), config.thickness, on_surface, above)
