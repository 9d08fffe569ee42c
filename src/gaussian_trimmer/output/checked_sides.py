"""From which sides a trim was judged, and from which it was not: what no accepted view shows is nobody's promise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.observed_angles import cameras_that_see, observed_angles
from gaussian_trimmer.planning.outline_views import angles_around
from gaussian_trimmer.result import TrimResult

_MAX_REACH_DEGREES = 36
"""Degrees of yaw to either side that one view judges at most: half the step of five views on a circle."""
_MAX_PITCH_DEGREES = 80.0
"""Pitch in degrees beyond which a view shows the top or the underside, and no side."""
_ALL_AROUND_DEGREES = 350
"""Degrees from which on nothing is called unseen."""


@dataclass(frozen=True, eq=False)
class CheckedSides:
    """What of the full circle around an object was judged, in whole degrees of yaw in the frame of its bounds."""

    accepted: BoolArray
    """Which degrees an accepted view shows, (360,)."""
    rejected: BoolArray
    """Which degrees only rejected views show, (360,)."""
    observed: BoolArray
    """Which degrees lie where the training cameras stood; all of them if no cameras are known, (360,)."""
    pitches: tuple[float, ...]
    """Pitches of the accepted views in degrees above the horizon, ascending, each once."""

    @property
    def checked(self) -> BoolArray:
        """Which degrees were judged, (360,): an accepted view shows them, and the cameras, if known, saw them."""
        return self.accepted & self.observed

    @property
    def degrees(self) -> int:
        """How many degrees were judged."""
        return int(np.count_nonzero(self.checked))

    @property
    def middle(self) -> int:
        """The degree in the middle of the longest run that was judged; 0 if there is none or it is the circle."""
        if self.checked.all() or not self.checked.any():
            return 0
        start, end = max(_runs(self.checked), key=lambda run: run[1] - run[0])
        return (start + end) // 2 % 360

    def sentence(self) -> str:
        """What was seen and what was not, without a full stop.

        >>> some = np.arange(360) < 54
        >>> CheckedSides(some, ~some, np.ones(360, bool), (30.0,)).sentence()
        'seen over 54 of 360 degrees, from 30 degrees above the horizon; the far side was not checked'
        """
        if self.degrees >= _ALL_AROUND_DEGREES:
            return f"seen from all around{self._heights()}"
        if not self.degrees:
            return "seen from no side; nothing was checked"
        rest = "the far side was" if self.degrees <= 180 else f"the other {360 - self.degrees} were"
        return f"seen over {self.degrees} of 360 degrees{self._heights()}; {rest} not checked"

    def _heights(self) -> str:
        """From which heights it was seen.

        >>> everything = np.ones(360, bool)
        >>> CheckedSides(everything, ~everything, everything, (-10.0, 5.0, 40.0))._heights()
        ', from 10 degrees below to 40 degrees above the horizon'
        """
        if not self.pitches:
            return ""
        ends = sorted({round(self.pitches[0]), round(self.pitches[-1])})
        words = [f"{abs(end)} degrees {'below' if end < 0 else 'above'}" for end in ends]
        return f", from {' to '.join(words)} the horizon"

    def verdict(self, yaw: int) -> str:
        """Why a direction was not judged, in a few words; empty if it was."""
        if self.checked[yaw % 360]:
            return ""
        if not self.observed[yaw % 360]:
            return "no photograph from here"
        return "the view was rejected" if self.rejected[yaw % 360] else "no view from here"

    def as_json(self) -> dict[str, Any]:
        """For the report."""
        return {
            "degrees": self.degrees,
            "of": 360,
            "sentence": self.sentence(),
            "yaw_ranges_degrees": _runs(self.checked),
            "pitches_degrees": [round(pitch, 1) for pitch in self.pitches],
        }


def checked_sides(result: TrimResult) -> CheckedSides:
    """From which sides a trim was judged."""
    views = [(view.view.camera, not view.rejected) for view in result.views]
    yaws, pitches = map(np.degrees, angles_around([camera for camera, _ in views], result.bounds))
    taken = np.array([good for _, good in views], np.bool_)
    aside = np.abs(pitches) <= _MAX_PITCH_DEGREES
    yaws %= 360
    reach = _reach(yaws[aside])
    accepted, rejected = (_shown(yaws[aside & chosen], reach) for chosen in (taken, ~taken))
    heights = tuple(float(pitch) for pitch in np.unique(np.round(pitches[taken], 1)))
    return CheckedSides(accepted, rejected & ~accepted, _observed(result.cameras, result.bounds), heights)


def _reach(yaws: Float64Array) -> float:
    """Half the usual step between the yaws of neighbouring views, so that views side by side show all between them."""
    places = np.unique(np.round(yaws, 1) % 360)
    gaps = np.diff(np.append(places, places[:1] + 360))
    return min(float(np.median(gaps)) / 2, _MAX_REACH_DEGREES) if len(places) > 1 else _MAX_REACH_DEGREES


def _shown(yaws: Float64Array, reach: float) -> BoolArray:
    """Which degrees lie within reach of a yaw, (360,)."""
    apart = np.abs((np.arange(360)[:, None] + 0.5 - yaws + 180) % 360 - 180)
    return np.asarray((apart <= reach).any(axis=1))


def _observed(cameras: Sequence[Camera], bounds: Bounds) -> BoolArray:
    seeing = cameras_that_see(cameras, bounds)
    if not seeing:
        return np.full(360, not cameras)
    first, span, _ = observed_angles(seeing, bounds, 0.0)
    return np.asarray((np.arange(360) + 0.5 - np.degrees(first)) % 360 <= np.degrees(span))


def _runs(flags: BoolArray) -> list[list[int]]:
    """First and one past the last degree of each run of True on the circle; the last may be beyond 360.

    >>> _runs((np.arange(360) < 10) | (np.arange(360) >= 300))
    [[300, 370]]
    """
    if flags.all():
        return [[0, 360]]
    starts = np.flatnonzero(flags & ~np.roll(flags, 1))
    return [[int(start), int(start + np.argmin(np.roll(flags, -start)))] for start in starts]
