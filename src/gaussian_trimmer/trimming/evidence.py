"""Which Gaussians belong to the object, by what they show with the object alone and in the scene.

Below and behind an object lie Gaussians that the scene hides, and that their labels cannot tell from the object's own.
Once the object is alone they form a halo around it. Before and beside it hang floaters, which are seen as what lies
behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate, mask_of_rows
from gaussian_trimmer.rendering.tile_renderer import draw
from gaussian_trimmer.settings import Share, Weight
from gaussian_trimmer.trimming.alpha_targets import ObjectRenders, OutlineViews
from gaussian_trimmer.views.view import HALF, clearly_nearer

TYPE_CHECKING = False
if TYPE_CHECKING:  # nothing is cut by default
    from gaussian_trimmer.trimming.straddlers import CutGaussians


@dataclass(frozen=True)
class EvidenceConfig:
    """When a Gaussian belongs to the object."""

    recover: bool = True
    """Allow Gaussians outside the selection to join the object."""
    prior: Weight = 1.0
    """Where masks decide, weight of the corrected label relative to the share of blend weight inside them; 0: the masks
    alone decide."""
    min_in_place: Share = 0.7
    """Smallest share of what a Gaussian shows of the object alone that must lie where the scene shows the object, too.
    Of others the scene hides too much: they would stick out. 0: all stay."""


def prune(
    gaussians: Gaussians,
    members: BoolArray,
    selection: BoolArray,
    views: OutlineViews,
    min_share: float,
    cut: CutGaussians | None = None,
) -> BoolArray:
    """Return the members of an object, (L,), without what the views do not show as part of it when the object is alone.

    A pixel is consistent where the scene shows at least half of the opacity that the object has alone, or where a known
    mask has it, and the object is seen where more than half of what the scene shows is the object. Where something
    clearly nearer than the object hides it, other than the ground, no view can tell, and nothing counts. A Gaussian
    that shows nowhere stays. Of others too small a share may be consistent; and what was not selected joins only if it
    is seen as the object in most of what it shows: labels spread to whatever lies near, be it floaters or hidden.

    Args:
        gaussians: the object and the Gaussians around it, L of them.
        members: which of these are the object's, whole or in part, (L,).
        selection: what is selected, (L,).
        views: where to look from.
        min_share: least share of what a Gaussian shows alone that has to be consistent.
        cut: those that are its own in part, with their parts; None: there are none.
    """
    split = np.zeros(0, np.int64) if cut is None else cut.rows
    whole = np.flatnonzero(members & ~mask_of_rows(split, len(members)))
    if cut is None:
        renders = views.render_part(gaussians, members, colours=False)
    else:
        inside = concatenate([gaussians.select(whole), cut.inner])
        outside = [gaussians.select(~members), *([cut.outer] if cut.outer else [])]
        renders = views.render(inside, concatenate(outside), colours=False)
    consistent, seen, shown = np.sum(_weights(renders), axis=0).T
    rows = np.concatenate([whole, split])
    gone = (consistent < min_share * shown) | (~selection[rows] & (seen < HALF * shown))
    joining = np.flatnonzero(~selection[rows] & ~gone)
    if len(joining):
        gone[joining] = _behind(renders, selection[rows], joining, views.radius)
    return mask_of_rows(rows[~gone], len(members))


def _behind(renders: ObjectRenders, chosen: BoolArray, joining: IntArray, radius: float) -> BoolArray:
    """Return which Gaussians the rest of the object hides even in the view that shows most of them, (J,).

    They shine through it, as the wall does behind a cupboard. What lies in its surface beside others is not hidden.

    Args:
        renders: views of the object with what joins it, M Gaussians.
        chosen: which of them are selected, (M,).
        joining: rows of those that join, (J,).
        radius: the object's radius in scene units.
    """
    inner = renders.scene.gaussians.select(renders.member)
    some, rest = inner.select(joining), inner.select(chosen)
    ones = [np.ones((1, *unknown.shape), np.float32) for unknown in renders.unknown]
    shown = renders.scene.weigh(ones)[:, renders.member][:, joining, 0]  # (views, J)
    best, of_best = np.unique(shown.argmax(axis=0), return_inverse=True)
    cameras = [renders.alone.cameras[view] for view in best]
    bare, before = (draw(part, cameras, colours=False) for part in (some, rest))
    beside = [
        (alpha > HALF) & ~clearly_nearer(nearest, depth, radius)
        for alpha, nearest, depth in zip(before.alpha, before.depth, bare.depth, strict=True)
    ]
    alone = bare.weigh([(~there)[None].astype(np.float32) for there in beside])[of_best, np.arange(len(joining)), 0]
    return np.asarray(shown.max(axis=0) < HALF * alone)


def _weights(renders: ObjectRenders) -> FloatArray:
    """Return blend weights of the object's Gaussians alone where each view can tell, (V, M, 3).

    They are those where it is consistent, where the object is seen, and all.
    """
    known = renders.shares if renders.masks is None else renders.masks
    counts = [~unknown for unknown in renders.unknown]
    return renders.weigh_alone(
        [
            np.stack([same & tells, (share > HALF) & tells, tells]).astype(np.float32)
            for same, share, tells in zip(renders.consistent, known, counts, strict=True)
        ]
    )
