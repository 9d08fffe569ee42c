"""Ways of running the trimmer that are measured side by side: its own settings, the paper's, and ablations of both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.runs import Variant
from gaussian_trimmer.masks import PAPER_SEGMENTER
from gaussian_trimmer.masks.sam import SamConfig, SamSegmenter, paper_sam
from gaussian_trimmer.trimming.config import SplitConfig, TrimConfig, paper_config

VIEW_COUNTS = (1, 2, 3, 5, 7, 10)
"""Numbers of virtual views that the paper compares."""
LABELS_ALONE, NEVER = 1000.0, 1e6
"""Weight of labels beside which the views' votes do not count; blend weight that no Gaussian has."""
REAL_VIEWS = 5
"""Training cameras that stand in for virtual ones where these are ablated."""


def variants() -> dict[str, Variant]:
    """All variants that need no trained model, by name; `default` comes first."""
    paper = Variant(paper_config(), PAPER_SEGMENTER)
    named = {"default": Variant(), "grabcut": Variant(segmenter="grabcut"), "paper-literal": _literal(paper)}
    named |= {name: Variant(config) for name, config in _stages(TrimConfig()).items()}
    return named | _ablated("", Variant()) | _ablated("paper", paper)


def _stages(base: TrimConfig) -> dict[str, TrimConfig]:
    """The configuration without each stage of the default, or without what a stage goes by."""
    labels, evidence = base.label_crf, base.evidence
    plane = replace(labels.support_plane, enabled=False)
    return {
        "no-label-crf": replace(base, label_crf=replace(labels, enabled=False)),
        "no-plane-rule": replace(base, label_crf=replace(labels, support_plane=plane)),
        "no-colour-model": replace(base, label_crf=replace(labels, colour=0.0)),
        "no-interior-trust": replace(base, label_crf=replace(labels, interior_trust=0.0)),
        "no-vote": replace(base, evidence=replace(evidence, prior=LABELS_ALONE)),
        "no-recover": replace(base, evidence=replace(evidence, recover=False)),
        "no-in-place": replace(base, evidence=replace(evidence, min_in_place=0.0)),
        "no-cuts": replace(base, refinement=replace(base.refinement, cut_above=NEVER)),
        "no-steps": replace(base, refinement=replace(base.refinement, steps=0)),
        "no-fit": replace(base, refine="off"),
        "no-filling": replace(base, background="clean"),
        "no-removal": replace(base, background="exact"),
    }


def sam_variants(model: Path) -> dict[str, Variant]:
    """Variants whose views a trained model segments; the folder is that of `--sam.model`."""
    ours = SamConfig(model=str(model))
    paper = Variant(paper_config(), SamSegmenter(paper_sam(ours)))
    named = {
        "sam-alone": Variant(segmenter=SamSegmenter(replace(ours, fusion=False))),
        "paper-sam-each-view": replace(paper, segmenter=SamSegmenter(replace(paper_sam(ours), prompt="box"))),
        "paper-sam-literal": _literal(paper),
    }
    return named | _ablated("sam", Variant(segmenter=SamSegmenter(ours))) | _ablated("paper-sam", paper)


def _literal(base: Variant) -> Variant:
    """The same from the distance of eq. 3 as it is printed."""
    return replace(base, config=replace(base.config, plan=replace(base.config.plan, framing="literal")))


def _ablated(prefix: str, base: Variant) -> dict[str, Variant]:
    """A variant, and what it becomes without one of its parts or with another one, by name."""

    def changed(**settings: object) -> Variant:
        return replace(base, config=replace(base.config, **settings))  # type: ignore[arg-type]

    bare = changed(context_radius=0.0)
    named = {
        "no-virtual-cameras": replace(base, training_views=REAL_VIEWS),
        "no-background": bare,
        "neither": replace(bare, training_views=REAL_VIEWS),
        "principal-axis-split": changed(split=SplitConfig("principal_axis")),
        "sagd-split": changed(split=SplitConfig("sagd")),
        "plane-split": changed(split=SplitConfig("plane")),
        "no-split": changed(split=SplitConfig("none")),
    }
    named |= {f"views-{n}": changed(plan=replace(base.config.plan, views=n)) for n in VIEW_COUNTS}
    return {prefix: base} | {f"{prefix}-{n}": v for n, v in named.items()} if prefix else named


def chosen_variants(names: tuple[str, ...], sam_model: Path | None = None) -> dict[str, Variant]:
    """The variants of these names; those with `sam` in their names need the model's folder."""
    known = variants() | (sam_variants(sam_model) if sam_model else {})
    for name in names:
        if name not in known:
            more = "" if sam_model else "; those of SAM need --sam-model"
            raise InputError(f"Unknown variant '{name}'; available: {', '.join(known)}{more}.")
    return {name: known[name] for name in names}
