"""Ways of running the trimmer that are measured side by side: its own settings, the paper's, and ablations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from gaussian_trimmer.config import SplitConfig, TrimConfig, paper_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, PAPER_SEGMENTER, Segmenter
from gaussian_trimmer.segmentation.segmenters.sam import SamConfig, SamSegmenter, paper_sam

VIEW_COUNTS = (1, 2, 3, 5, 7, 10)
"""Numbers of virtual views that the paper compares."""
REAL_VIEWS = 5
"""Training cameras that stand in for virtual ones where these are ablated."""


@dataclass(frozen=True)
class Variant:
    """One way of running the trimmer."""

    config: TrimConfig = field(default_factory=TrimConfig)
    segmenter: str | Segmenter = DEFAULT_SEGMENTER
    training_views: int = 0
    """Use this many training cameras instead of virtual ones."""


def without_planning_or_background(base: Variant) -> dict[str, Variant]:
    """The paper's ablation of virtual camera planning (VCP) and background augmentation (BA), by row of its table."""
    bare = replace(base, config=replace(base.config, context_radius=0.0))
    return {
        "No VCP": replace(base, training_views=REAL_VIEWS),
        "No background augmentation": bare,
        "No VCP and BA": replace(bare, training_views=REAL_VIEWS),
        "Full GaussianTrimmer": base,
    }


def with_view_counts(base: Variant) -> dict[int, Variant]:
    """The paper's numbers of virtual views, each as a variant."""
    return {n: with_views(base, n) for n in VIEW_COUNTS}


def with_views(base: Variant, n: int) -> Variant:
    """The same with n virtual views."""
    return replace(base, config=replace(base.config, plan=replace(base.config.plan, views=n)))


def variants() -> dict[str, Variant]:
    """All variants by name; `default` comes first."""
    base, paper = TrimConfig(), paper_config()
    ablated = without_planning_or_background(Variant())
    named = {
        "default": Variant(),
        "grabcut": Variant(segmenter="grabcut"),
        "paper": Variant(paper, PAPER_SEGMENTER),
        "sagd": Variant(replace(paper, split=SplitConfig("sagd")), PAPER_SEGMENTER),
        "principal-axis": Variant(replace(base, split=SplitConfig("principal_axis"))),
        "sagd-split": Variant(replace(base, split=SplitConfig("sagd"))),
        "no-split": Variant(replace(base, split=SplitConfig("none"))),
        "no-second-evidence": Variant(replace(base, evidence=replace(base.evidence, second_evidence=False))),
        "no-recover": Variant(replace(base, evidence=replace(base.evidence, recover=False))),
        "no-label-crf": Variant(replace(base, label_crf=replace(base.label_crf, enabled=False))),
        "no-virtual-cameras": ablated["No VCP"],
        "no-background": ablated["No background augmentation"],
        "neither": ablated["No VCP and BA"],
    }
    return named | {f"views-{n}": variant for n, variant in with_view_counts(Variant()).items()}


def sam_variants(model: Path) -> dict[str, Variant]:
    """Variants whose views a trained model segments: ours, and the paper's with its ablations, by name.

    Args:
        model: folder with a model of the SAM family, as `SamConfig.model`.

    Raises:
        InputError: the model cannot be loaded, or ONNX Runtime is missing.
    """
    ours = SamConfig(model=str(model))
    follow, alone, as_published = (
        SamSegmenter(options) for options in (ours, replace(ours, fusion=False), paper_sam(ours))
    )
    paper = Variant(paper_config(), as_published)
    ablated = without_planning_or_background(paper)

    def with_split(split: SplitConfig) -> Variant:
        return replace(paper, config=replace(paper.config, split=split))

    named = {
        "sam": Variant(segmenter=follow),
        "sam-alone": Variant(segmenter=alone),
        "paper-sam": paper,
        "paper-sam-close": replace(paper, config=replace(paper.config, plan=TrimConfig().plan)),
        "paper-sam-sagd-split": with_split(SplitConfig("sagd")),
        "paper-sam-plane-split": with_split(SplitConfig("plane")),
        "paper-sam-no-split": with_split(SplitConfig("none")),
        "paper-sam-no-virtual-cameras": ablated["No VCP"],
        "paper-sam-no-background": ablated["No background augmentation"],
        "paper-sam-neither": ablated["No VCP and BA"],
    }
    return named | {f"paper-sam-views-{n}": variant for n, variant in with_view_counts(paper).items()}


def chosen_variants(names: tuple[str, ...], sam_model: Path | None = None) -> dict[str, Variant]:
    """The variants of these names; `ablations` stands for all that need no trained model.

    Args:
        sam_model: folder with the model of variants with `sam` in their names.

    Raises:
        InputError: no variant has such a name, or a model is missing.
    """
    known = variants()
    if "ablations" in names:
        return known
    if sam_model is not None:
        known |= sam_variants(sam_model)
    for name in names:
        if name not in known:
            more = "" if sam_model else "; those of SAM need --sam-model"
            raise InputError(f"Unknown variant '{name}'; available: ablations, {', '.join(known)}{more}.")
    return {name: known[name] for name in names}
