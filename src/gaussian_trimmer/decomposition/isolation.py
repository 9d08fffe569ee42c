"""The object alone: Gaussians that show mostly where the scene does not show the object are none of its own.

Below and behind an object lie Gaussians that the scene hides, and that the evidence of the whole scene cannot tell from
the object's own. Once the object is alone they form a halo around it.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.decomposition.coverage import OutlineViews, Sight
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.parallel import parallel_map


def find_in_place(gaussians: Gaussians, members: BoolArray, views: OutlineViews, min_share: float) -> BoolArray:
    """Members of which enough shows in place when the object is alone, (L,).

    A pixel is in place where the scene shows at least half of the opacity that the object has alone, or where a known
    mask has it. Where something clearly nearer than the object hides it, other than the ground, no view can tell, and
    nothing counts. A Gaussian that shows nowhere stays.

    Args:
        gaussians: the object and the Gaussians around it, L of them.
        members: which of them are the object, (L,).
        views: where to look from.
        min_share: least share of what a Gaussian shows alone that has to be in place.
    """
    sights = views.look(gaussians.select(members), gaussians.select(~members))
    weights = np.sum(list(parallel_map(_weights, sights)), axis=0)
    kept = members.copy()
    kept[members] = weights[:, 0] >= min_share * weights[:, 1]
    return kept


def _weights(sight: Sight) -> FloatArray:
    """Blend weights of the object's Gaussians alone: in place, and wherever the view can tell, (M, 2)."""
    counts = ~sight.unknown
    return sight.alone.weigh(np.stack([sight.in_place & counts, counts]).astype(np.float32))
