"""Segmenters: the contract, and the table of those that exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, make_dataclass, replace
from typing import Any, Literal, Protocol, cast

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.lazy_import import load
from gaussian_trimmer.views.view import View

MaskSource = Literal["labels", "renderings", "photographs", "given"]


class Segmenter(Protocol):
    """Finds the object in every view, starting from where the selected object is.

    Four further methods are optional. `describe() -> str` is a line for the report, in place of the name.
    `own_cameras(cameras: CameraSet | None) -> list[Camera]` names the cameras whose pictures the segmenter has masks
    of; the command line then uses these in place of virtual ones. `report_to(report: Callable[[str], None])` gives a
    slow segmenter a function to call while it works, with "2 of 5" when the second of five views begins.
    `segment_together(views, gaussians)` is called in place of `segment`, if it is there, by the trimmer: it
    also gets the Gaussians that the views show, so that masks of different views can be held against each other.

    The attribute `mask_source` is optional too and says what the masks are drawn from: "labels" corrected in 3D,
    "renderings" of the scene (the default), "photographs", or "given" by the user. The object's outline is fitted only
    to masks that know more of it than the scene does: the last two. One that may be called from several threads at once
    says so by `thread_safe = True`, see `parallel.is_thread_safe`.
    """

    name: str

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return a mask (H, W) for each view, True on the object. Views are in order of yaw, as frames of a video."""
        ...


SEGMENTERS = {
    "silhouette": "gaussian_trimmer.masks.silhouette:SilhouetteSegmenter",
    "grabcut": "gaussian_trimmer.masks.grabcut:GrabCutSegmenter",
    "sam": "gaussian_trimmer.masks.sam:SamSegmenter",
    "sam2": "gaussian_trimmer.masks.sam2_video:Sam2Segmenter",
    "mask-files": "gaussian_trimmer.masks.mask_files:MaskFilesSegmenter",
}
OPTIONS = {
    "grabcut": "gaussian_trimmer.masks.grabcut:GrabCutConfig",
    "sam": "gaussian_trimmer.masks.sam:SamConfig",
    "sam2": "gaussian_trimmer.masks.sam2_video:Sam2Config",
    "mask-files": "gaussian_trimmer.masks.mask_files:MaskFilesConfig",
}
"""Dataclass of the options of each segmenter that has any, its only argument; `--NAME.OPTION` on the command line."""
DEFAULT_SEGMENTER = "silhouette"
PAPER_SEGMENTER = "grabcut"
"""The segmenter of the paper's preset: the paper's own, SAM2, needs weights that must be downloaded."""


def get_segmenter(name: str, *options: Any) -> Segmenter:
    """Return the segmenter of that name, made with its options, if any are given.

    Raises:
        InputError: no segmenter has that name, or what it needs is not installed.
    """
    if name not in SEGMENTERS:
        raise InputError(f"Unknown segmenter '{name}'; available: {', '.join(SEGMENTERS)}.")
    return cast(Segmenter, load(SEGMENTERS[name])(*options))


def options_kind(name: str) -> type[Any] | None:
    """Return the dataclass of a segmenter's options, or None if it has none."""
    return load(OPTIONS[name]) if name in OPTIONS else None


def all_options() -> type[Any]:
    """Make a dataclass with a field for each segmenter that has options: its name, with underscores."""
    kinds = {field_name(name): load(kind) for name, kind in OPTIONS.items()}
    fields = [(name, kind, field(default_factory=kind)) for name, kind in kinds.items()]
    return make_dataclass("SegmenterOptions", fields, frozen=True)


def options_of(name: str, options: Any) -> Any:
    """Return the options of one segmenter among those of all, as `all_options` has them; None if it has none."""
    return getattr(options, field_name(name), None)


def segmenter_with(name: str, options: Any) -> Segmenter:
    """Return the segmenter of that name with its options among those of all.

    Raises:
        InputError: as `get_segmenter`.
    """
    own = options_of(name, options)
    return get_segmenter(name, own) if own is not None else get_segmenter(name)


def description_of(segmenter: Segmenter) -> str:
    """Return what a segmenter says of itself for the report: its name, or more."""
    return str(segmenter.describe()) if hasattr(segmenter, "describe") else name_of(segmenter)


def name_of(plug_in: Any) -> str:
    """Return the name that a segmenter states, or that of its class."""
    return str(getattr(plug_in, "name", None) or type(plug_in).__name__)


def mask_source_of(segmenter: Segmenter) -> MaskSource:
    """Return what a segmenter draws its masks from; renderings, if it does not say."""
    return cast(MaskSource, getattr(segmenter, "mask_source", "renderings"))


def knows_outlines(segmenter: Segmenter) -> bool:
    """Tell whether a segmenter's masks know more of the object's outline than the scene does."""
    return mask_source_of(segmenter) in ("photographs", "given")


def paper_options(options: Any) -> Any:
    """Return options of all segmenters, as `all_options` has them, with the paper's choices."""
    from gaussian_trimmer.masks.sam import paper_sam

    return replace(options, sam=paper_sam(options.sam))


def field_name(name: str) -> str:
    """Return the field of `all_options` that belongs to a segmenter.

    >>> field_name("mask-files")
    'mask_files'
    """
    return name.replace("-", "_")
