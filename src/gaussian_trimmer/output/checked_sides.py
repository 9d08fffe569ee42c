"""From which sides a trim was judged, and from which it was not, and from which side much of a selection was taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.trimming.result import TrimmedObject
from gaussian_trimmer.views.observed_angles import cameras_that_see, observed_angles
from gaussian_trimmer.views.small_views import angles_around

_MAX_REACH_DEGREES = 36
"""Degrees of yaw to either side that one view judges at most: half the step of five views on a circle."""
_MAX_PITCH_DEGREES = 80.0
"""Pitch in degrees beyond which a view shows the top or the underside, and no side."""
_ALL_AROUND_DEGREES = 350
"""Degrees from which on nothing is called unseen."""
_SHRUNK_SHARE, _SHRUNK_LEAST = 0.3, 0.02
"""Share of a side's selected Gaussians, and of all that are selected, from which on it is said that they are gone."""
_SIDES = ("at 0 degrees", "at 180 degrees", "at 90 degrees", "at 270 degrees", "at its top", "at its foot")
"""The ends of the axes of an object's bounds; degrees of yaw as in the pictures."""
_FAR_OFF = 2.0
"""Half extents from the centre beyond which Gaussians are of no side."""


@dataclass(frozen=True, eq=False)
class CheckedSides:
    """What of the full circle around an object was judged, in whole degrees of yaw in the frame of its bounds."""

    checked: BoolArray
    """Which degrees an accepted view shows and the training cameras, if known, saw, (360,)."""
    observed: BoolArray
    """Which degrees these cameras saw; all of them if none are known, (360,)."""
    pitches: tuple[float, ...]
    """Pitches of the accepted views in degrees above the horizon, ascending, each once."""

    @property
    def degrees(self) -> int:
        """Number of degrees that were judged."""
        return int(np.count_nonzero(self.checked))

    @property
    def middle(self) -> int:
        """The degree in the middle of the longest run that was judged; 0 if there is none or it is the circle."""
        start, end = max(_runs(self.checked), key=lambda run: run[1] - run[0], default=[0, 0])
        return (start + end) // 2 % 360 if end - start < 360 else 0

    def sentence(self) -> str:
        """Say what was seen and what was not, without a full stop.

        >>> some = np.arange(360) < 54
        >>> CheckedSides(some, some, (30.0,)).sentence()
        'checked over 54 of 360 degrees, from 30 degrees above the horizon; the far side was not checked'
        """
        if not self.degrees:
            return "no side was checked"
        ends = sorted({round(self.pitches[0]), round(self.pitches[-1])})
        words = " to ".join(f"{abs(end)} degrees {'below' if end < 0 else 'above'}" for end in ends)
        if self.degrees >= _ALL_AROUND_DEGREES:
            return f"checked from all sides, from {words} the horizon"
        rest = "the far side was" if self.degrees <= 180 else f"the other {360 - self.degrees} were"
        return f"checked over {self.degrees} of 360 degrees, from {words} the horizon; {rest} not checked"

    def verdict(self, yaw: int) -> str:
        """Say why a direction was not judged, in a few words; empty if it was."""
        if self.checked[yaw % 360]:
            return ""
        return "no accepted view from here" if self.observed[yaw % 360] else "no photograph from here"

    def as_json(self) -> dict[str, Any]:
        """Return this for the report."""
        return {
            "degrees": self.degrees,
            "of": 360,
            "sentence": self.sentence(),
            "yaw_ranges_degrees": _runs(self.checked),
            "pitches_degrees": [round(pitch, 1) for pitch in self.pitches],
        }


def checked_sides(part: TrimmedObject, cameras: Sequence[Camera]) -> CheckedSides:
    """Return from which sides an object was judged, and from which the training cameras saw it."""
    yaws, pitches = map(np.degrees, angles_around([view.view.camera for view in part.views], part.bounds))
    accepted = np.array([not view.rejected for view in part.views], np.bool_)
    aside, observed = np.abs(pitches) <= _MAX_PITCH_DEGREES, np.ones(360, np.bool_)
    # Half the usual step between neighbouring views, so that views side by side show all between them.
    places = np.unique(np.round(yaws[aside], 1) % 360)
    gaps = np.diff(np.append(places, places[:1] + 360))
    reach = min(float(np.median(gaps)) / 2 if len(places) > 1 else 360.0, _MAX_REACH_DEGREES)
    degrees = np.arange(360) + 0.5
    apart = np.abs((degrees[:, None] - yaws[aside & accepted] + 180) % 360 - 180)
    if cameras:
        seeing = cameras_that_see(cameras, part.bounds)
        first, span, _ = observed_angles(seeing, part.bounds, 0.0) if seeing else (0.0, -1.0, 0.0)
        observed = (degrees - np.degrees(first)) % 360 <= np.degrees(span)
    heights = tuple(float(pitch) for pitch in np.unique(np.round(pitches[accepted], 1)))
    return CheckedSides((apart <= reach).any(axis=1) & observed, observed, heights)


def shrunk_side(part: TrimmedObject, positions: FloatArray, gone: BoolArray) -> str | None:
    """Say from which side of an object most of its selection was taken, without a full stop; None if from none.

    Args:
        part: the object.
        positions: centres of the selected Gaussians, (C, 3).
        gone: which of them are neither in it nor in another object, (C,).
    """
    local = (positions - part.bounds.centre) @ part.bounds.axes.T / np.maximum(part.bounds.half_extents, 1e-12)
    axis, near = np.abs(local).argmax(axis=1), np.abs(local).max(axis=1) < _FAR_OFF
    side = 2 * axis + (np.take_along_axis(local, axis[:, None], 1)[:, 0] < 0)
    total, lost = (np.bincount(side[near & rows], minlength=len(_SIDES)) for rows in (np.ones_like(gone), gone))
    shrunk = (lost >= _SHRUNK_SHARE * total) & (lost >= _SHRUNK_LEAST * len(gone)) & (lost > 0)
    if part.refused or not shrunk.any():
        return None
    most = int(np.argmax(lost * shrunk))
    return f"{lost[most]:,} of {total[most]:,} selected Gaussians {_SIDES[most]} are not in the object"


def _runs(flags: BoolArray) -> list[list[int]]:
    """Return first and one past the last degree of each run of True on the circle; the last may be beyond 360.

    >>> _runs((np.arange(360) < 10) | (np.arange(360) >= 300))
    [[300, 370]]
    """
    if flags.all():
        return [[0, 360]]
    starts = np.flatnonzero(flags & ~np.roll(flags, 1))
    return [[int(start), int(start + np.argmin(np.roll(flags, -start)))] for start in starts]
