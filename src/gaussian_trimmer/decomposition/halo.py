"""The halo of an object: Gaussians that, alone, show mostly where the scene does not show the object.

Below and behind an object lie Gaussians that the scene hides, and that the evidence of the whole scene cannot tell from
the object's own. Once the object is alone they form a halo around it.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.decomposition.alpha_targets import ObjectRender, OutlineViews
from gaussian_trimmer.decomposition.splitting import Decomposition
from gaussian_trimmer.gaussians import FloatArray, Gaussians, concatenate
from gaussian_trimmer.parallel import parallel_map


def prune_halo(gaussians: Gaussians, parts: Decomposition, views: OutlineViews, min_share: float) -> Decomposition:
    """Take from an object the members of which too little is consistent with the scene when the object is alone.

    A pixel is consistent where the scene shows at least half of the opacity that the object has alone, or where a known
    mask has it. Where something clearly nearer than the object hides it, other than the ground, no view can tell, and
    nothing counts. A Gaussian that shows nowhere stays.

    Args:
        gaussians: the object and the Gaussians around it, L of them.
        parts: how these are divided.
        views: where to look from.
        min_share: least share of what a Gaussian shows alone that has to be consistent.
    """
    whole = np.flatnonzero(parts.members & parts.whole())
    inside = [gaussians.select(whole), *([parts.inner] if parts.inner else [])]
    outside = [gaussians.select(~parts.members), *([parts.outer] if parts.outer else [])]
    renders = views.render(concatenate(inside), concatenate(outside))
    weights = np.sum(list(parallel_map(_weights, renders)), axis=0)
    lost = np.zeros(len(gaussians), np.bool_)
    lost[np.concatenate([whole, parts.split])] = weights[:, 0] < min_share * weights[:, 1]
    return parts.without(lost)


def _weights(render: ObjectRender) -> FloatArray:
    """Return blend weights of the object's Gaussians alone: where consistent, and where the view can tell, (M, 2)."""
    counts = ~render.unknown
    return render.alone.weigh(np.stack([render.consistent & counts, counts]).astype(np.float32))
