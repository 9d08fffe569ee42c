"""Protocols: the rules by which a figure was measured, so that it can be compared with figures of the same rules alone.

Published codes differ in the size at which they render, the opacity that makes a mask, whether what hides the object
counts, where they cut grey masks, and which views they leave out. A mask of another size is enlarged or reduced to that
of the ground truth by the nearest pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, Truth, at_size
from gaussian_trimmer.evaluation.layouts import DatasetTask
from gaussian_trimmer.evaluation.metrics import THRESHOLD
from gaussian_trimmer.gaussians import FloatArray

OWN = "own"
_GREY = 128 / 255
_TENTH_OF_255 = 10 / 255


@dataclass(frozen=True)
class Protocol:
    """One way of measuring."""

    name: str
    title: str = ""
    """Where it is written, for tables."""
    rules: tuple[Literal["alone", "in scene"], ...] = ("alone", "in scene")
    """The rules of occlusion that count."""
    threshold: float = THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    size: Literal["mask", "camera"] | int = "mask"
    """At which size views are rendered: that of the mask, of the camera, or this width in pixels."""
    truth_above: float | None = None
    """Share of white above which a pixel of the ground truth's mask is object; None keeps greys as coverage."""
    masks_above: float = _GREY
    """The same for masks that a method rendered itself."""
    skips_reference: bool = False
    """Whether the first mask of an object, from which methods start, is left out."""
    by_order: bool = False
    """Whether masks whose names no picture has are those of the pictures in order, if there are as many."""
    missing_is_empty: bool = False
    """Whether a mask that a method did not render is one of nothing."""

    def describe(self) -> str:
        """Return the rules in words, for tables."""
        sizes = {"mask": "at the size of their masks", "camera": "at the size of their cameras"}
        words = [f"views are rendered {sizes.get(str(self.size), f'{self.size} pixels wide')}"]
        words += ["enlarged to the mask by the nearest pixel"] if self.size != "mask" else []
        words += [f"mask: alpha > {self.threshold:g}"]
        words += [f"ground truth > {self.truth_above:g}" if self.truth_above is not None else "ground truth > 0.5"]
        words += ["without the reference view"] if self.skips_reference else []
        words += ["a missing mask counts as empty"] if self.missing_is_empty else []
        return f"protocol {self.name} ({self.title}): {', '.join(self.rules)}; {'; '.join(words)}"

    def counted(self, task: DatasetTask) -> DatasetTask:
        """Return the task with the pictures that count."""
        return replace(task, pictures=task.pictures[1:]) if self.skips_reference and len(task.pictures) > 1 else task

    def truth(self, coverage: FloatArray) -> FloatArray:
        """Return the coverage (H, W) as it is compared with."""
        return coverage if self.truth_above is None else (coverage > self.truth_above).astype(np.float32)

    def view(self, view: TestView, camera: Camera) -> TestView:
        """Return a view with ground truth, seen by its picture's own camera, as the protocol compares it."""
        truth = Truth(self.truth(view.alone.coverage), view.alone.counted)
        if self.size != "mask":
            width = camera.width if self.size == "camera" else int(self.size)
            height = round(width * camera.height / camera.width)
            view = replace(view, camera=at_size(camera, width, height, Path(camera.name)))
        return replace(view, alone=truth, in_scene=truth)


_SPIN_NERF = Protocol(
    "usual", "every mask counts: Jumpat/SegmentAnythingin3D, issues 34 and 78; pairing as in umangi-jain/gaussiancut",
    ("in scene",), truth_above=0.0, by_order=True,
)  # fmt: skip
_OPEN_GAUSSIAN = Protocol(
    "opengaussian", "yanmin-wu/OpenGaussian, scripts/compute_lerf_iou.py", ("alone",), _TENTH_OF_255,
    truth_above=_TENTH_OF_255, masks_above=_TENTH_OF_255, missing_is_empty=True,
)  # fmt: skip
_OF_DATA_SETS: Mapping[str, tuple[Protocol, ...]] = {
    "nvos": (
        Protocol(
            "cob-gs", "ZestfulJX/COB-GS, render.py and eval/eval_NVOS.py", ("alone",), 0.5, 1008, truth_above=_GREY
        ),
        Protocol(
            "saga", "Jumpat/SegAnyGAussians, render.py and utils/camera_utils.py; where masks are cut is assumed",
            ("in scene",), 0.5, 1600, truth_above=_GREY,
        ),
        Protocol(
            "sa3d", "Jumpat/SegmentAnythingin3D, render.py of branch sa3d-gs, lib/evaluate.py and configs/llff of main",
            ("alone",), 0.1, 1008, truth_above=0.0,
        ),
    ),
    "lerf-mask": (
        Protocol(
            "gaussian-grouping", "lkeab/gaussian-grouping, script/eval_lerf_mask.py", ("in scene",), size="camera",
            truth_above=_GREY,
        ),
    ),
    "spin-nerf": (
        _SPIN_NERF,
        replace(
            _SPIN_NERF, name="without-reference", title="as usual, without the view from which methods start",
            skips_reference=True,
        ),
    ),
    "lerf-ovs": (_OPEN_GAUSSIAN,),
    "3d-ovs": (_OPEN_GAUSSIAN,),
}  # fmt: skip
"""Data set -> protocols of published codes. LLFF's pictures are 4032 pixels wide; COB-GS and SA3D take a quarter, and
Inria's code, on which SAGA builds, reduces what is wider than 1600 pixels to that."""
OWN_RULES = Protocol(OWN)
PROTOCOLS = {
    layout: {protocol.name: protocol for protocol in (OWN_RULES, *known)} for layout, known in _OF_DATA_SETS.items()
}
"""Data set -> name -> protocol."""


def protocol_of(layout: str, name: str) -> Protocol:
    """Return the protocol of that name.

    Raises:
        InputError: the data set has none of that name.
    """
    known = PROTOCOLS[layout]
    if name not in known:
        raise InputError(f"There is no protocol '{name}' of {layout}; available: {', '.join(known)}.")
    return known[name]
