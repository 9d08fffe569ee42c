"""Every setting of the trimmer: one small dataclass a stage, nested in `TrimConfig`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from gaussian_trimmer.decomposition.contact import ContactConfig
from gaussian_trimmer.decomposition.evidence import EvidenceConfig
from gaussian_trimmer.decomposition.straddlers import BoundaryConfig
from gaussian_trimmer.planning.virtual_cameras import PlanConfig
from gaussian_trimmer.segmentation.acceptance import AcceptConfig
from gaussian_trimmer.segmentation.label_crf import LabelFieldConfig
from gaussian_trimmer.settings import Range, Vector, check_settings

__all__ = [
    "AcceptConfig", "BoundaryConfig", "ContactConfig", "EvidenceConfig", "LabelFieldConfig", "PlanConfig",
    "SplitConfig", "TrimConfig", "check_config", "paper_config",
]  # fmt: skip


@dataclass(frozen=True)
class SplitConfig:
    """What is done to Gaussians that straddle the boundary."""

    rule: Literal["plane", "principal_axis", "sagd", "none"] = "plane"
    """`plane`: cut at the silhouette; `principal_axis`: the paper's eqs. 8-9; `sagd`: one shrunken child; `none`."""
    contact: ContactConfig = field(default_factory=ContactConfig)
    """Hidden Gaussians that cross the surface below the object."""


@dataclass(frozen=True)
class TrimConfig:
    """Every setting of the trimmer, by stage."""

    up: Vector | None = None
    """Up vector of the scene; not given: found from the cameras, else from the ground plane."""
    plan: PlanConfig = field(default_factory=PlanConfig)
    neighbours: Annotated[float, Range(0, 100)] = 1.8
    """Non-object Gaussians within this many object radii surround the object in the views (eq. 7); 0: none."""
    labels: LabelFieldConfig = field(default_factory=LabelFieldConfig)
    accept: AcceptConfig = field(default_factory=AcceptConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    boundary: BoundaryConfig = field(default_factory=BoundaryConfig)
    split: SplitConfig = field(default_factory=SplitConfig)


def paper_config(config: TrimConfig | None = None) -> TrimConfig:
    """The paper's choices: its framing, no correction in 3D, every mask believed, splits along principal axes."""
    config = config or TrimConfig()
    return replace(
        config,
        plan=replace(config.plan, framing="paper"),
        labels=replace(config.labels, enabled=False),
        accept=AcceptConfig(least_overlap=0.0, least_silhouette=1, least_views=0.0, least_remaining=0.0),
        evidence=replace(config.evidence, prior=0.0, recover=False, second_evidence=False),
        boundary=replace(config.boundary, least_share=0.05, least_area=1e-6, along_ray_limit=1.0),
        split=SplitConfig("principal_axis"),
    )


def check_config(config: TrimConfig) -> None:
    """Refuse settings that have no meaning, before any work is done.

    Raises:
        InputError: a setting is out of its range; the message names it as the command line does.
    """
    check_settings(config)
