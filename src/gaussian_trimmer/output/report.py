"""The report of a trim, as JSON holds it: of one object what happened to it, of several a list of that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import LabelArray
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.output.checked_sides import checked_sides, shrunk_side
from gaussian_trimmer.trimming.result import THE_OBJECT, RowLabel, TrimmedObject, TrimResult


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
    report: dict[str, Any] = {
        "version": __version__,
        "inputs": dict(inputs or {}),
        "configuration": asdict(result.config),
        "segmenter": result.segmenter,
    }
    labels, counts = result.labels, _count_scene(result)
    stems = file_stems((part.id, part.name) for part in result.objects)
    entries = [
        {
            "id": part.id,
            "name": part.name,
            "file": f"{stems[part.id]}{suffix}" if len(part.gaussians) else None,
            "gaussians": len(part.gaussians),
            **_describe_object(result, part, labels),
            "seconds": _rounded(part.seconds),
        }
        for part in result.objects
    ]
    if len(entries) == 1:
        counts = {"scene": counts.pop("scene"), **entries[0].pop("counts"), **counts}
        report |= entries[0]
    else:
        report["objects"] = entries
        counts |= {
            "objects": len(result.objects),
            "in_objects": sum(len(part.gaussians) for part in result.objects),
            "claimed_by_several": result.contested,
            "refused": sum(bool(part.refused) for part in result.objects),
        }
    return report | {"counts": counts, "seconds": _rounded({**(seconds or {}), **result.seconds})}


def object_entries(report: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return what a report says of each object, with its name, its file and its counts."""
    return [report] if "objects" not in report else list(report["objects"])


def alerts(warnings: Sequence[str], shrunk_side: str | None) -> list[str]:
    """Return the warnings of an object but that of a smaller side, which the summaries tell by themselves."""
    return [sentence for sentence in warnings if sentence != f"{shrunk_side}."]


def _describe_object(result: TrimResult, part: TrimmedObject, labels: LabelArray) -> dict[str, Any]:
    """What the report says of one object."""
    chosen = part.selected_rows
    shrunk = shrunk_side(part, result.scene.means[chosen], labels[chosen] == 0)
    doubts = [] if part.refused else [part.up.doubt(), shrunk and f"{shrunk}."]
    return {
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
                **_camera_entry(view.view.camera),
            }
            for view in part.views
        ],
        "checked": checked_sides(part, result.cameras).as_json(),
        "shrunk_side": shrunk,
        "refused": part.refused or None,
        "not_fitted": part.not_fitted or None,
        "not_filled": part.not_filled or None,
        "warnings": [*part.warnings, *filter(None, doubts)],
        "counts": _count_object(result, part, labels),
    }


def _count_scene(result: TrimResult) -> dict[str, int]:
    """Count Gaussians of the scene, those that were split or were hidden and discarded, and rows of the background."""
    label = result.background_label
    return {
        "scene": len(result.scene),
        "split": len(np.unique(result.background_source[label == RowLabel.SPLIT_OUTSIDE])),
        "hidden": len(np.setdiff1d(result.discarded, np.concatenate([p.selected_rows for p in result.objects]))),
        "relit": int(np.count_nonzero(label == RowLabel.RELIT)),
        "filled": int(np.count_nonzero(label == RowLabel.FILLED)),
        "background": len(label),
    }


def _count_object(result: TrimResult, part: TrimmedObject, labels: LabelArray) -> dict[str, int]:
    """What became of the Gaussians of a selection, and how many rows the object has.

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
    if len(result.objects) > 1:
        counts["went_to_other_objects"] = elsewhere
    return counts | {
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


def _camera_entry(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }


def _rounded(seconds: Mapping[str, float]) -> dict[str, float]:
    return {stage: round(time, 4) for stage, time in seconds.items()}
