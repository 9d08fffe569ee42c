"""The pictures to segment: two renderings for each view, the object in its surroundings and the object in isolation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering, parallel_map
from gaussian_trimmer.scene_crop import SceneCrop
from gaussian_trimmer.views import HALF, View, bounding_box, clearly_nearer, to_reference


@dataclass(frozen=True, eq=False)
class SceneRenderings:
    """What the cameras of a crop see, with the blend weights of its L Gaussians, of which S are selected."""

    pictures: Sequence[Rendering]
    """The object, the Gaussians around it, and what hides them."""
    isolated: Sequence[Rendering]
    """The selected object alone."""
    visible: FloatArray
    """Blend weight of each Gaussian in the pictures, in pixels of five views of 512 x 512, (L,)."""
    visible_alone: FloatArray
    """Blend weight of each selected Gaussian rendered alone, (S,)."""


def render_crop(crop: SceneCrop, renderer: Renderer) -> SceneRenderings:
    """Draw a crop and the selected object in it for each of its cameras."""

    def drawn(gaussians: Gaussians) -> list[Rendering]:
        return list(parallel_map(lambda c: renderer.render(gaussians, c, weights=True), crop.cameras, using=[renderer]))

    pictures, isolated = drawn(crop.shown), drawn(crop.local.select(crop.selected))
    visible, alone = (visible_weight([p.weights for p in shown], crop.cameras) for shown in (pictures, isolated))
    return SceneRenderings(pictures, isolated, visible[: len(crop.local)], alone)


def visible_weight(weights: Sequence[FloatArray], cameras: Sequence[Camera]) -> FloatArray:
    """Blend weight of each Gaussian over all views, in pixels of five views of 512 x 512, (N,).

    Args:
        weights: blend weights in each view, in pixels of that view, (N,) each.
        cameras: the cameras of the views.
    """
    return to_reference(np.sum(weights, axis=0), cameras)


def complete_views(
    crop: SceneCrop, renderings: SceneRenderings, probability: FloatArray, renderer: Renderer
) -> list[View]:
    """What the segmenter is given for each camera of a crop.

    Args:
        crop: the object and the Gaussians around it, L of them.
        renderings: what its cameras see.
        probability: the corrected labels, (L,).
        renderer: draws the labels.
    """
    shares = np.zeros((len(crop.shown), 2), np.float32)
    shares[: len(probability)] = np.stack([crop.selected, probability], axis=1)
    views = []
    values = parallel_map(
        lambda camera: renderer.blend_values(crop.shown, camera, shares), crop.cameras, using=[renderer]
    )
    drawn = zip(crop.cameras, renderings.pictures, renderings.isolated, values, strict=True)
    for camera, picture, alone, shown in drawn:
        visible, expected = np.ascontiguousarray(shown[..., 0]), np.ascontiguousarray(shown[..., 1])
        whole = alone.alpha > HALF
        hidden = whole & (visible <= HALF) & clearly_nearer(picture.depth, alone.depth, crop.bounds.radius)
        views.append(View(camera, picture, alone.alpha, visible, expected, bounding_box(whole), hidden))
    return views
