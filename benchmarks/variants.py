"""Ways of running the trimmer that are measured side by side: its own settings, the paper's, and ablations of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.trials import Way, way_of
from gaussian_trimmer.masks.sam import SamModel, load_sam
from gaussian_trimmer.trimming.config import SplitConfig, TrimConfig, paper_config

VIEW_COUNTS = (1, 2, 3, 5, 7, 10)
"""Numbers of virtual views that the paper compares."""
NEVER = 1e6
"""Blend weight that no Gaussian has."""
REAL_VIEWS = 5
"""Training cameras that stand in for virtual ones where these are ablated."""


def variants(sam_model: Path | None = None) -> dict[str, Way]:
    """All variants by name, `default` first; those with `sam` in their names need the model's folder."""
    named = _ablated("", TrimConfig()) | _ablated("paper", paper_config(), paper=True)
    named = {"default": way_of(), **{name: way_of(config) for name, config in stages(TrimConfig()).items()}, **named}
    if sam_model is not None:
        sam = load_sam(sam_model)
        named |= _ablated("sam", TrimConfig(), sam) | _ablated("paper-sam", paper_config(), sam, paper=True)
    return named


def stages(base: TrimConfig) -> dict[str, TrimConfig]:
    """The configuration without each stage of the default, or without what a stage goes by."""
    labels, evidence = base.label_crf, base.evidence
    plane = replace(labels.support_plane, enabled=False)
    return {
        "no-label-crf": replace(base, label_crf=replace(labels, enabled=False)),
        "no-plane-rule": replace(base, label_crf=replace(labels, support_plane=plane)),
        "no-colour-model": replace(base, label_crf=replace(labels, colour=0.0)),
        "no-interior-trust": replace(base, label_crf=replace(labels, interior_trust=0.0)),
        "no-recover": replace(base, evidence=replace(evidence, recover=False)),
        "no-in-place": replace(base, evidence=replace(evidence, min_in_place=0.0)),
        "no-cuts": replace(base, refinement=replace(base.refinement, cut_above=NEVER)),
        "no-steps": replace(base, refinement=replace(base.refinement, steps=0)),
        "no-fit": replace(base, refine="off"),
        "no-filling": replace(base, background="clean"),
        "no-removal": replace(base, background="exact"),
    }


def _ablated(prefix: str, base: TrimConfig, sam: SamModel | None = None, paper: bool = False) -> dict[str, Way]:
    """A way of trimming, and what it becomes without one of its parts or with another one, by name."""

    def changed(training_views: int = 0, **settings: Any) -> Way:
        return way_of(replace(base, **settings), sam=sam, paper=paper, training_views=training_views)

    named = {
        "": changed(),
        "literal": changed(plan=replace(base.plan, framing="literal")),
        "no-virtual-cameras": changed(REAL_VIEWS),
        "no-background": changed(context_radius=0.0),
        "neither": changed(REAL_VIEWS, context_radius=0.0),
        "principal-axis-split": changed(split=SplitConfig("principal_axis")),
        "centroid-split": changed(split=SplitConfig("centroid")),
        "sagd-split": changed(split=SplitConfig("sagd")),
        "plane-split": changed(split=SplitConfig("plane")),
        "no-split": changed(split=SplitConfig("none")),
        **{f"views-{n}": changed(plan=replace(base.plan, views=n)) for n in VIEW_COUNTS},
    }
    return {"-".join(filter(None, (prefix, name))): way for name, way in named.items() if prefix or name}


def chosen_variants(names: Sequence[str], sam_model: Path | None = None) -> dict[str, Way]:
    """The variants of these names."""
    known = variants(sam_model)
    for name in names:
        if name not in known:
            more = "" if sam_model else "; those of SAM need --sam-model"
            raise InputError(f"Unknown variant '{name}'; available: {', '.join(known)}{more}.")
    return {name: known[name] for name in names}
