"""An object alone and in its scene: what of it the scene confirms, and the alpha that it should show alone.

A photograph's pixel belongs to the object, or it does not; only those on its outline are shared. Gaussians are softer
than that, and what they show near an outline is a guess that has to be sharpened. Two guesses are at hand, which err to
different sides: the share of the picture that the object's Gaussians have where the whole scene is rendered, S, is too
small where others shine through or lie before the object's edge; the opacity of the object rendered alone, A, is too
large where the scene hides what sticks out. So A is right where the scene shows at least half of it. Where it shows
less, the geometric mean of A and 2 S takes over, which is as large at a half and nothing where the scene shows nothing.
This is made twice as steep (docs/decisions.md), so that an outline grows sharp where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate
from gaussian_trimmer.geometry.planes import Plane
from gaussian_trimmer.rendering.projection import Projection, project_views
from gaussian_trimmer.rendering.tile_renderer import Drawing, draw_projected
from gaussian_trimmer.trimming.fitting import Target
from gaussian_trimmer.views.view import HALF, clearly_nearer

_SHARPENING_FACTOR = 2.0
"""Factor by which coverage is steeper at an outline than the Gaussians show it."""
_TRUSTED_SHARE = 0.5
"""Share of the object's opacity alone that the scene has to show for that opacity to be right."""


@dataclass(frozen=True, eq=False)
class ObjectRenders:
    """An object of M Gaussians in V views: alone, and among all N of its scene."""

    member: BoolArray
    """Which of the N are the object's, (N,)."""
    alone: Drawing
    """The object by itself, without colours."""
    scene: Drawing
    """The object and what is around it. Without masks only tiles that the object reaches are drawn."""
    shares: Sequence[FloatArray]
    """Sum of the blend weights that the object's Gaussians have in the scene, S, (H, W) each."""
    masks: Sequence[FloatArray] | None
    """Known coverage of what is visible of the object, in place of the labels', (H, W) each."""
    consistent: Sequence[BoolArray]
    """Where the scene shows at least half of what the object shows alone, or where the mask has it, (H, W) each."""
    unknown: Sequence[BoolArray]
    """Where something clearly nearer hides the object, so that the view cannot tell what is there, (H, W) each."""

    def weigh_alone(self, images: Sequence[FloatArray]) -> FloatArray:
        """Return the blend weights of the object's Gaussians alone under images of each view (L, H, W), (V, M, L)."""
        return self.alone.weigh(images)[:, self.member]


@dataclass(frozen=True, eq=False)
class OutlineViews:
    """Small views of an object, and what is known of it there."""

    cameras: Sequence[Camera]
    masks: Sequence[FloatArray] | None
    """Coverage of what is visible of the object in each view, (H, W); None if it must follow from the labels."""
    radius: float
    """The object's radius in scene units."""
    ground: Plane | None = None
    """What it stands on, if anything: nothing of it is below."""
    occluders: Gaussians | None = None
    """What else the views show before the object; None: nothing."""

    projected: dict[str, Projection] = field(default_factory=dict)
    """Everything in the views once it was drawn, for another object in it."""

    def render(self, inner: Gaussians, background: Gaussians, *, colours: bool) -> ObjectRenders:
        """Render an object, alone and among the Gaussians around it, in each view; these with colours or without."""
        everything = concatenate([inner, background, *([self.occluders] if self.occluders else [])])
        member = np.arange(len(everything)) < len(inner)
        return self._render(everything, member, project_views(everything, self.cameras, colours=colours), colours)

    def render_part(self, gaussians: Gaussians, member: BoolArray, *, colours: bool) -> ObjectRenders:
        """Return the same of those of some Gaussians that are the object's, (N,); these are the same at every call."""
        hiding = self.occluders or gaussians.select(slice(0))
        everything = concatenate([gaussians, hiding]) if len(hiding) else gaussians
        if not self.projected:
            self.projected["everything"] = project_views(everything, self.cameras)
        member = np.append(member, np.zeros(len(hiding), np.bool_))
        return self._render(everything, member, self.projected["everything"], colours)

    def _render(self, everything: Gaussians, member: BoolArray, projection: Projection, colours: bool) -> ObjectRenders:
        alone = draw_projected(everything, projection.of(member), colours=False)
        # Where the object does not reach, only a mask can ask for something to be shown.
        seen_in = projection.around(member) if self.masks is None else projection
        together = draw_projected(everything, seen_in, values=member[:, None].astype(np.float32), colours=colours)
        shares = [share for (share,) in together.values]
        if self.masks is None:
            consistent = [s >= _TRUSTED_SHARE * alpha for s, alpha in zip(shares, alone.alpha, strict=True)]
        else:
            consistent = [mask > HALF for mask in self.masks]
        unknown = []
        for camera, depth, nearest, seen in zip(self.cameras, alone.depth, together.depth, consistent, strict=True):
            hidden = clearly_nearer(nearest, depth, self.radius) & ~seen
            unknown.append(hidden if self.ground is None else hidden & (self.ground.pixel_heights(camera, depth) >= 0))
        return ObjectRenders(member, alone, together, shares, self.masks, consistent, unknown)


def coverage_targets(renders: ObjectRenders) -> list[Target]:
    """Return what the object alone should show in each view, with no weight where the view cannot tell."""
    targets = []
    for number, (opacity, rgb) in enumerate(zip(renders.alone.alpha, renders.scene.rgb, strict=True)):
        if renders.masks is None:
            shown = np.minimum(opacity, np.sqrt(np.maximum(opacity * renders.shares[number], 0) / _TRUSTED_SHARE))
            coverage = np.clip(HALF + _SHARPENING_FACTOR * (shown - HALF), 0, 1)
        else:
            coverage = renders.masks[number]
        picture = np.concatenate([np.clip(rgb, 0, 1) * coverage, coverage[None]]).astype(np.float32)
        counts = np.where(renders.unknown[number], np.float32(0), np.float32(1))
        # The three channels of colour count as much together as coverage does.
        weight = np.stack([counts / 3, counts / 3, counts / 3, counts])
        targets.append(Target(renders.alone.cameras[number], picture, weight))
    return targets


def resized_mask(mask: BoolArray, camera: Camera) -> FloatArray:
    """Return how much of each pixel of a camera's smaller image a mask covers, in [0, 1], (H, W)."""
    size = camera.width, camera.height
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)


def thin_share(alphas: Sequence[FloatArray]) -> float:
    """Return how much of what an object covers in some views is less than three pixels wide: leaves, wires, spokes.

    Args:
        alphas: the object's opacity in each, (H, W).
    """
    covered, thick, square = 0, 0, np.ones((3, 3), np.uint8)
    for alpha in alphas:
        mask = (alpha > HALF).astype(np.uint8)
        covered += int(mask.sum())
        thick += int(cv2.morphologyEx(mask, cv2.MORPH_OPEN, square).sum())
    return 1 - thick / covered if covered else 0.0
