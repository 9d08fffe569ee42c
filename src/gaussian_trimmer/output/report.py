"""The report of a trim, as JSON holds it: what happened to each object and to the scene, and the same in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, LabelArray, quaternions_of
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import THE_OBJECT, RowLabel, TrimmedObject, TrimResult
from gaussian_trimmer.trimming.up_vector import up_text
from gaussian_trimmer.views.small_views import angles_around
from gaussian_trimmer.views.virtual_cameras import cameras_that_see, observed_angles

_MAX_REACH_DEGREES = 36
"""Degrees of yaw to either side that one view judges at most: half the step of five views on a circle."""
_MAX_PITCH_DEGREES = 80.0
"""Pitch in degrees beyond which a view shows the top or the underside, and no side."""
_ALL_AROUND_DEGREES = 350
"""Degrees from which on nothing is called unseen."""
_SHRUNK_SHARE, _SHRUNK_LEAST = 0.3, 0.1
"""Share of a side's selected Gaussians, and of all that are selected, from which on it is said that they are gone."""
_SIDES = ("at 0 degrees", "at 180 degrees", "at 90 degrees", "at 270 degrees", "at its top", "at its foot")
"""The ends of the axes of an object's bounds; degrees of yaw as in the pictures."""
_FAR_OFF = 2.0
"""Half extents from the centre beyond which Gaussians are of no side."""
SUMMARY = "summary.csv"
_COUNTS = ("selected", "object", "kept", "cut", "removed", "discarded", "added")
_BOX = ("x", "y", "z", "length", "width", "height", "qw", "qx", "qy", "qz")
SUMMARY_COLUMNS = ("name", "state", "message", *_COUNTS, *_BOX, "up_confidence", "seconds", "scene", "selection")
"""Columns of the table of all objects of a trim or a batch."""
_FATES = {
    "kept": "kept",
    "cut": "cut at the outline",
    "removed": "removed",
    "discarded": "discarded",
    "went_to_other_objects": "given to other objects",
}
"""What becomes of selected Gaussians, by the names of the counts: each is counted once."""


def summary_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row of a table for each object of a report, with `SUMMARY_COLUMNS`: the box is its `bounds`."""
    rows, alone = list[dict[str, Any]](), len(report["objects"]) == 1
    for entry in report["objects"]:
        bounds, counts = entry["bounds"], entry["counts"]
        box = [*bounds["centre"], *(2 * np.array(bounds["half_extents"]))]
        box += quaternions_of(np.array(bounds["axes"]).T[None])[0].tolist()
        cells = [
            entry["name"],
            "not trimmed" if entry["refused"] else "done",
            entry["refused"] or " ".join(entry["warnings"]),
            *(counts[name] for name in _COUNTS),
            *(round(float(number), 6) for number in box),
            entry["up"]["confidence"],
            round(sum((report if alone else entry)["seconds"].values()), 3),
            *(report["inputs"].get(name) or "" for name in ("scene", "selection")),
        ]
        rows.append(dict(zip(SUMMARY_COLUMNS, cells, strict=True)))
    return rows


def describe(
    result: TrimResult,
    inputs: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    suffix: str = ".ply",
) -> dict[str, Any]:
    """Return the report of a trim.

    Args:
        result: the trim.
        inputs: where the scene, the selection and so on came from, as JSON holds it.
        seconds: time taken outside the trimmer, by stage.
        suffix: ending of the splat files.
    """
    labels, stems = result.labels, file_stems((part.id, part.name) for part in result.objects)
    return {
        "version": __version__,
        "inputs": dict(inputs or {}),
        "configuration": asdict(result.config),
        "objects": [_describe_object(result, part, labels, f"{stems[part.id]}{suffix}") for part in result.objects],
        "counts": _count_scene(result),
        "seconds": _rounded({**(seconds or {}), **result.seconds}),
    }


def sentences(report: Mapping[str, Any]) -> list[str]:
    """Return what to say of each object of a report, in its order, and last of the scene without them.

    What may be wrong is not among it: these are sentences already, the `warnings` of each object.
    """
    counts, ups = report["counts"], {up_text(**entry["up"]) for entry in report["objects"]}
    if counts["refused"] == counts["objects"]:
        return [*map(_of_object, report["objects"]), "Not written, since nothing was trimmed."]
    said = [f"{counts['background']:,} Gaussians"]
    said += [f"{counts['hidden']:,} discarded that only objects hid"] if counts["hidden"] else []
    said += [f"{counts['unusable']:,} unusable or in a black fringe left out"] if counts["unusable"] else []
    said += [f"{counts['filled']:,} new ones where objects stood"] if counts["filled"] else []
    said += [f"shadow removed from {counts['relit']:,}"] if counts["relit"] else []
    said += [f"{counts['claimed_by_several']:,} claimed by several objects"] if counts["claimed_by_several"] else []
    up = ups.pop() if len(ups) == 1 else "found for each object by itself"
    return [*map(_of_object, report["objects"]), f"{', '.join(said)}. Up: {up}."]


def _of_object(entry: Mapping[str, Any]) -> str:
    if entry["refused"]:
        return f"Not trimmed: {entry['refused'].rstrip('.')}. It is the selection as it came."
    counts, views = entry["counts"], entry["views"]
    fates = [f"{counts[name]:,} {fate}" for name, fate in _FATES.items() if counts[name] or name in ("kept", "removed")]
    far = f" ({counts['floaters']:,} of those removed lay far away)" if counts["floaters"] else ""
    judged = "" if all(view["judged"] for view in views) else ", whose masks follow the selection"
    accepted = sum(view["accepted"] for view in views)
    said = [
        f"{entry['gaussians']:,} Gaussians",
        f"Of {counts['selected']:,} selected, {', '.join(fates)}{far}; {counts['added']:,} added",
        entry["shrunk_side"],
        f"{accepted} of {len(views)} views used{judged}; {entry['checked']['sentence']}",
        f"{counts['fitted']:,} fitted to the outline" if counts["fitted"] else "",
        entry["not_fitted"] and f"Not fitted: {entry['not_fitted'].rstrip('.')}",
        entry["not_filled"] and f"Not filled in: {entry['not_filled'].rstrip('.')}",
    ]
    return " ".join(f"{sentence}." for sentence in said if sentence)


def _describe_object(result: TrimResult, part: TrimmedObject, labels: LabelArray, file: str) -> dict[str, Any]:
    """Return what the report says of one object."""
    doubt = None if part.refused else part.up.doubt()
    gone, checked = labels[part.selected_rows] == 0, checked_sides(part, result.cameras)[0]
    return {
        "id": part.id,
        "name": part.name,
        "file": file if len(part.gaussians) else None,
        "gaussians": len(part.gaussians),
        "up": {
            "direction": part.up.direction.tolist(),
            "source": part.up.source,
            "confidence": round(part.up.confidence, 4),
        },
        "bounds": {
            "centre": part.bounds.centre.tolist(),
            "half_extents": part.bounds.half_extents.tolist(),
            "axes": part.bounds.axes.tolist(),
        },
        "views": [
            {
                "accepted": not view.rejected,
                "judged": view.judged,
                "reason": view.rejected or None,
                "hidden": round(view.view.hidden_share, 3),
                **_describe_camera(view.view.camera),
            }
            for view in part.views
        ],
        "checked": {"degrees": int(np.count_nonzero(checked)), "sentence": checked_sentence(part, checked)},
        "shrunk_side": shrunk_side(part, result.scene.means[part.selected_rows], gone),
        "refused": part.refused or None,
        "not_fitted": part.not_fitted or None,
        "not_filled": result.rest.not_filled.get(part.id),
        "warnings": [*part.warnings, *result.rest.warnings.get(part.id, ()), *filter(None, [doubt])],
        "counts": _count_object(result, part, labels),
        "seconds": _rounded(part.seconds),
    }


def _count_scene(result: TrimResult) -> dict[str, int]:
    """Count Gaussians of the scene, those that were split or were hidden and discarded, and rows of the background."""
    label, blank = result.background_label, result.scene.blank
    selected = np.concatenate([part.selected_rows for part in result.objects])
    return {
        "scene": len(result.scene),
        "objects": len(result.objects),
        "in_objects": sum(len(part.gaussians) for part in result.objects),
        "claimed_by_several": result.contested,
        "refused": sum(bool(part.refused) for part in result.objects),
        "split": len(np.unique(result.background_source[label == RowLabel.SPLIT_OUTSIDE])),
        "unusable": int(np.count_nonzero(blank[result.discarded])),
        "hidden": int(np.count_nonzero(~np.isin(result.discarded, selected) & ~blank[result.discarded])),
        "relit": int(np.count_nonzero(label == RowLabel.RELIT)),
        "filled": int(np.count_nonzero(label == RowLabel.FILLED)),
        "background": len(label),
    }


def _count_object(result: TrimResult, part: TrimmedObject, labels: LabelArray) -> dict[str, int]:
    """Count what became of the Gaussians of a selection, and the rows that the object has.

    Every selected Gaussian is counted once: it was kept, cut (the object has parts of it), discarded (it is in no
    file), went to another object, or was removed (it is in the background). `added` ones joined the object, `floaters`
    are removed ones that lay far off. `object` and `fitted` count rows, of which a Gaussian may have several.
    """
    left, rows = part.selected_rows, np.unique(part.source_index)
    counts = {"selected": len(left)}
    cut = part.source_index[part.label == RowLabel.SPLIT_INSIDE]
    for name, taken in (("cut", cut), ("kept", rows), ("discarded", result.discarded)):
        found = np.isin(left, taken)
        counts[name] = int(np.count_nonzero(found))
        left = left[~found]
    elsewhere = int(np.count_nonzero(labels[left]))
    return counts | {
        "went_to_other_objects": elsewhere,
        "removed": len(left) - elsewhere,
        "added": len(np.setdiff1d(rows, part.selected_rows, assume_unique=True)),
        "fitted": len(part.fitted),
        "floaters": part.floaters,
        "object": len(part.gaussians),
    }


def file_stems(objects: Iterable[tuple[int, str]]) -> dict[int, str]:
    """Return names of objects' files without their endings, by the objects' ids.

    >>> file_stems([(1, "1"), (2, "red mug"), (3, "Red_Mug"), (4, "object 9"), (5, "object")])
    {1: 'object_1', 2: 'object_red_mug', 3: 'object_Red_Mug_3', 4: 'object_9', 5: 'object'}

    Args:
        objects: ids and names; the name of one without a name is its id.
    """
    stems: dict[int, str] = {}
    for number, name in objects:
        safe = safe_file_name(name)
        stem = safe if safe == THE_OBJECT or safe.startswith(f"{THE_OBJECT}_") else f"{THE_OBJECT}_{safe}"
        while stem.casefold() in map(str.casefold, stems.values()):
            stem = f"{stem}_{number}"
        stems[number] = stem
    return stems


def checked_sides(part: TrimmedObject, cameras: Sequence[Camera]) -> tuple[BoolArray, BoolArray]:
    """Return which degrees of yaw around an object an accepted view judged, (360,), and which the cameras saw, (360,).

    What the training cameras, if known, did not see counts as not judged. Degrees are those of the object's bounds.
    """
    yaws, pitches = map(np.degrees, angles_around([view.view.camera for view in part.views], part.bounds))
    aside, observed = np.abs(pitches) <= _MAX_PITCH_DEGREES, np.ones(360, np.bool_)
    # Half the widest step between neighbouring views, so that views side by side show all between them, however near
    # to each other some are; wider ones are gaps.
    places = np.unique(np.round(yaws[aside], 1) % 360)
    gaps = np.diff(np.append(places, places[:1] + 360))
    reach = gaps[gaps <= 2 * _MAX_REACH_DEGREES].max(initial=0) / 2 or _MAX_REACH_DEGREES
    degrees, accepted = np.arange(360) + 0.5, np.array([not view.rejected for view in part.views], np.bool_)
    apart = np.abs((degrees[:, None] - yaws[aside & accepted] + 180) % 360 - 180)
    if cameras:
        seeing = cameras_that_see(cameras, part.bounds)
        first, span, _ = observed_angles(seeing, part.bounds, 0.0) if seeing else (0.0, -1.0, 0.0)
        observed = (degrees - np.degrees(first)) % 360 <= np.degrees(span)
    return (apart <= reach).any(axis=1) & observed, observed


def middle_degree(flags: BoolArray) -> int:
    """Return the degree in the middle of the longest run of True on the circle (360,); 0 if there is none or it is all.

    >>> middle_degree((np.arange(360) < 10) | (np.arange(360) >= 300))
    335
    """
    starts = np.flatnonzero(flags & ~np.roll(flags, 1))
    runs = [(int(np.argmin(np.roll(flags, -start))), -int(start)) for start in starts]
    length, start = max(runs, default=(0, 0))
    return (length // 2 - start) % 360


def why_unchecked(yaw: int, checked: BoolArray, observed: BoolArray) -> str:
    """Return why a direction, a degree of yaw, was not judged, in a few words; empty if it was."""
    if checked[yaw % 360]:
        return ""
    return "no accepted view from here" if observed[yaw % 360] else "no photograph from here"


def judged_pitches(part: TrimmedObject) -> list[float]:
    """Return pitches of an object's accepted views in degrees above the horizon, ascending, each once."""
    _, pitches = angles_around([view.view.camera for view in part.views if not view.rejected], part.bounds)
    return [float(pitch) for pitch in np.unique(np.round(np.degrees(pitches), 1))]


def checked_sentence(part: TrimmedObject, checked: BoolArray) -> str:
    """Say, without a full stop, which degrees of yaw around an object were judged, (360,)."""
    heights, degrees = judged_pitches(part), int(np.count_nonzero(checked))
    if not degrees:
        return "no side was checked"
    ends = sorted({round(heights[0]), round(heights[-1])})
    words = " to ".join(f"{abs(end)} degrees {'below' if end < 0 else 'above'}" for end in ends)
    if degrees >= _ALL_AROUND_DEGREES:
        return f"checked from all sides, from {words} the horizon"
    rest = "the far side was" if degrees <= 180 else f"the other {360 - degrees} were"
    return f"checked over {degrees} of 360 degrees, from {words} the horizon; {rest} not checked"


def shrunk_side(part: TrimmedObject, positions: np.ndarray, gone: BoolArray) -> str | None:
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
    share = 100 * lost[most] / total[most]
    counts = f"{lost[most]:,} of {total[most]:,} Gaussians"
    return f"It lost {share:.0f} % of what was selected {_SIDES[most]} ({counts}); look there first"


def _describe_camera(camera: Camera) -> dict[str, Any]:
    arrays = {"K": camera.K.tolist(), "world_to_camera": camera.world_to_camera.tolist()}
    return {"name": camera.name, "width": camera.width, "height": camera.height, **arrays}


def changed_settings(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a report that are not the defaults, by their names with dots."""
    defaults = flat(asdict(TrimConfig()))
    return {name: value for name, value in flat(configuration).items() if value != defaults.get(name)}


def flat(settings: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested settings by names with dots."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": value}
    return found


def _rounded(seconds: Mapping[str, float]) -> dict[str, float]:
    return {stage: round(time, 4) for stage, time in seconds.items()}
