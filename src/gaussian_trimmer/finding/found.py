"""What finding the objects of a scene returns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.surface.visible_surface import VisibleSurface
from gaussian_trimmer.trimming.up_vector import UpVector

SURE = 0.5
"""How sure the program must be of an object, from 0 to 1, so that it is trimmed unless it is taken out."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is thought of one region of the visible surface, or of a surface of the room."""

    region: int | None
    """Number of the region; None for a surface of the room."""
    shown: float
    """Share of the views' pixels that it fills."""
    seen: float
    """Share of the views in which it is seen well."""
    view: int
    """Number of the view that shows it best."""
    centre: Float64Array
    """Middle of its box, in the scene's coordinates, (3,)."""
    size: Float64Array
    """Length along both horizontal axes of the frame and height of its box, in scene units, (3,)."""
    confidence: float
    """How sure it is that this is one object, 0 to 1."""
    rests_on: str
    """What it rests on, in words; empty if nothing was found."""
    doubts: tuple[str, ...]
    """Why it may be no object; there are some if and only if it is unsure."""

    @property
    def sure(self) -> bool:
        """Whether it is trimmed unless it is taken out."""
        return self.confidence >= SURE

    @property
    def why(self) -> str:
        """What it rests on and, if it is unsure, why."""
        return ", ".join(text for text in (self.rests_on, *self.doubts) if text)


@dataclass(frozen=True, eq=False)
class FoundObject(Verdict):
    """One object, or one surface of the room."""

    id: int
    """Its number among the labels, from 1."""
    colour: Float64Array
    """Its mean colour, 0 to 1, (3,)."""
    gaussians: int
    """Number of its Gaussians."""

    @property
    def kind(self) -> str:
        """`object`, or `surface` for a table top, floor or wall."""
        return "surface" if self.region is None else "object"


@dataclass(frozen=True, eq=False)
class FoundObjects:
    """The objects of a scene of N Gaussians, the sure ones first."""

    scene: Gaussians
    labels: IntArray
    """Number of the object that each Gaussian belongs to, 0 for the rest, (N,)."""
    objects: tuple[FoundObject, ...]
    views: tuple[Viewpoint, ...]
    """Where the scene was looked at from."""
    looked_at: BoolArray
    """Which Gaussians were looked at, (N,): all but the ceiling and what is above head height below one."""
    up: UpVector
    seconds: Mapping[str, float]
    """Time taken by each step."""
    surface: VisibleSurface | None = None
    """What shows of the scene; None if it was looked at in tiles."""

    def __repr__(self) -> str:
        sure = sum(found.sure for found in self.objects)
        return f"<FoundObjects: {sure} sure, {len(self.objects) - sure} unsure, of {len(self.scene):,} Gaussians>"

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[FoundObject]:
        return iter(self.objects)

    def mask(self, number: int) -> BoolArray:
        """Return which Gaussians one object has, (N,).

        Raises:
            InputError: there is no object of that number.
        """
        if number not in {found.id for found in self.objects}:
            raise InputError(f"There is no object {number}; there are {len(self.objects)}, numbered from 1.")
        return np.asarray(self.labels == number)

    def selections(self, *, unsure: bool = False) -> dict[int, BoolArray]:
        """Return the rough selections (N,) of the objects by their numbers, as `trim_objects` takes them.

        Args:
            unsure: with the objects that the program is not sure of.
        """
        return {found.id: self.mask(found.id) for found in self.objects if found.sure or unsure}
