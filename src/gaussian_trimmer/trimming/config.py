"""Every setting of the trimmer: one small dataclass for each stage, nested in `TrimConfig`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Annotated, Any, Literal

from gaussian_trimmer.cameras import vector_of_up
from gaussian_trimmer.settings import Component, Range, from_plain
from gaussian_trimmer.trimming.acceptance import AcceptanceConfig
from gaussian_trimmer.trimming.evidence import EvidenceConfig
from gaussian_trimmer.trimming.label_crf import LabelCrfConfig
from gaussian_trimmer.trimming.refinement import RefineConfig
from gaussian_trimmer.views.virtual_cameras import PlanConfig

CONTEXT_RADIUS = 1.8
"""Radius around the object's centre, in object radii, within which other Gaussians are rendered with the object."""


@dataclass(frozen=True)
class BoundaryConfig:
    """Which Gaussians straddle the boundary."""

    band: Annotated[int, Range(1, 64)] = 2
    """Distance from a mask's contour, in pixels, within which contributing Gaussians are looked up."""
    contributors: Annotated[int, Range(1, 256)] = 10
    """Number of Gaussians looked up at each of these pixels, those of largest blend weight."""


@dataclass(frozen=True)
class SplitConfig:
    """What is done with Gaussians that straddle the boundary."""

    rule: Literal["plane", "principal_axis", "centroid", "sagd", "none"] = "none"
    """`plane`: cut at the silhouette; `principal_axis`: eqs. 8 and 9 of the paper, where the silhouette crosses the
    axis; `centroid`: the same at the middle of the axis, as the paper's text says; `sagd`: SAGD's single, smaller
    child; `none`: no Gaussian is split."""


@dataclass(frozen=True)
class TrimConfig:
    """Every setting of the trimmer, by stage."""

    up: tuple[Component, ...] | None = None
    """Which way is up. By default it is found from the cameras, or else from the ground. A fourth number is the
    confidence of an up vector that was found."""
    plan: PlanConfig = field(default_factory=PlanConfig)
    context_radius: Annotated[float, Range(0, 100)] = CONTEXT_RADIUS
    """Gaussians within this many object radii of the object are rendered with it (eq. 7); 0: none."""
    label_crf: LabelCrfConfig = field(default_factory=LabelCrfConfig)
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    boundary: BoundaryConfig = field(default_factory=BoundaryConfig)
    split: SplitConfig = field(default_factory=SplitConfig)
    refine: Literal["fit", "off"] = "fit"
    """`fit`: the object's Gaussians that lie across its outline are cut and fitted to it, so that the object by itself
    has sharp edges; `off`: whole Gaussians of the object keep their numbers."""
    refinement: RefineConfig = field(default_factory=RefineConfig)
    background: Literal["filled", "clean", "exact"] = "filled"
    """How the scene without the object is made. `filled`: what only the object hid is left out, and the flat surfaces
    that it stood on, hung on or leaned against go on where it was, without its shadow; `clean`: nothing is made up, and
    holes stay; `exact`: every Gaussian that is not the object's, as it was."""
    with_what_stands_on_it: bool = False
    """What stands on the object leaves the scene with it, and is in neither file. By default vases stay when their
    table goes, in the air, and the trim tells of it; nothing that anything else holds leaves."""

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> TrimConfig:
        """Return the defaults, with settings by the names that the command line has for them.

        Raises:
            InputError: there is no setting of that name, or it cannot have that value.

        >>> TrimConfig.of({"plan.views": 7, "label-crf.enabled": False}).plan.views
        7
        """
        nested: dict[str, Any] = {}
        for name, value in settings.items():
            *stages, last = name.lstrip("-").replace("-", "_").split(".")
            reduce(lambda inner, stage: inner.setdefault(stage, {}), stages, nested)[last] = value
        if nested.get("up") is not None:
            nested["up"] = vector_of_up(nested["up"])
        config: TrimConfig = from_plain(nested, cls, "TrimConfig")
        return config


def paper_config(config: TrimConfig | None = None) -> TrimConfig:
    """The paper's choices: its centroid, no correction of labels in 3D, splits along axes, votes of masks alone.

    Args:
        config: settings to start from, the defaults if not given; those that the paper's choices do not touch are kept.
    """
    config = config or TrimConfig()
    return replace(
        config,
        plan=replace(config.plan, framing="paper"),
        label_crf=replace(config.label_crf, enabled=False),
        evidence=replace(config.evidence, prior=0.0, recover=False, min_in_place=0.0),
        split=SplitConfig("principal_axis"),
        refine="off",
        background="exact",
    )
