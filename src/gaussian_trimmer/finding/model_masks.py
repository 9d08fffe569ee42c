"""What a promptable model, such as the segmenter sam, says of regions that touch: that they are one thing.

It is asked in a few of the views that the scene is looked at from. A click deep inside a region gives several masks: of
a part, a thing, several things. The share of its neighbour that they take is counted by how sure the model is of each
and how much of the clicked region it covers, over all views by what they show. Where it is more than half, both are
likelier one thing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gaussian_trimmer.finding.contacts import Contacts, one_thing
from gaussian_trimmer.finding.visible_surface import VisibleSurface, evenly_spread
from gaussian_trimmer.gaussians import Float64Array, Gaussians, IntArray
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.segmenters.prompts import Prompt, middle_points
from gaussian_trimmer.selecting.marks import Viewpoint
from gaussian_trimmer.selecting.model_masks import PromptableModel
from gaussian_trimmer.selecting.overview import drawn_part
from gaussian_trimmer.selecting.viewed_scene import small_view

_VIEWS = 4
"""Number of views in which the model is asked, evenly spread."""
_MIN_PIXELS = 64
"""Smallest number of pixels of a region in a view, so that it is clicked there."""
_CLICKS = 2
_SHARPNESS = 4
"""Power of score and coverage by which masks are weighed: the best ones decide."""
_WEIGHT, _EVEN, _MOST = 2.0, 0.5, 1.0
"""Change of the log-odds with the share of the neighbour that the masks take, the share from which on they speak for
one thing, and the largest change. Masks of one part say nothing: a pot and its leaves are two to a model."""


@dataclass(frozen=True, eq=False)
class _Answers:
    """What the model said of R regions."""

    members: IntArray
    """A Gaussian of each region, (R,)."""
    taken: Float64Array
    """Pixels of each region (columns) that are taken by the masks of each (rows), over all views, (R, R)."""
    shown: Float64Array
    """Pixels of each region in the views in which each other was clicked, (R, R)."""


class AskedModel:
    """Log-odds of contacts that take the model's masks into account; asked when the first contacts are given.

    Args:
        scene: all N Gaussians.
        surface: what shows of it.
        views: where it is looked at from.
        model: draws masks for clicks.
        renderer: draws the views.
    """

    def __init__(
        self,
        scene: Gaussians,
        surface: VisibleSurface,
        views: Sequence[Viewpoint],
        model: PromptableModel,
        renderer: Renderer,
    ) -> None:
        self._scene, self._surface, self._model, self._renderer = scene, surface, model, renderer
        self._views = [replace(view, camera=small_view(view.camera)) for view in evenly_spread(views, _VIEWS)]
        self._answers: _Answers | None = None

    def __call__(self, contacts: Contacts) -> Float64Array:
        """Return log-odds that the regions of each contact are one thing, (P,)."""
        answers = self._answers = self._answers or self._asked(contacts)
        now = contacts.regions[answers.members]  # the region that each one asked about has become part of
        numbers, place = np.unique(now, return_inverse=True)
        first, second = np.searchsorted(numbers, contacts.pairs.T)
        onto = (place[:, None] == np.arange(len(numbers))).astype(np.float64)
        taken, shown = (onto.T @ table @ onto for table in (answers.taken, answers.shown))
        both = shown[first, second] + shown[second, first]
        share = (taken[first, second] + taken[second, first]) / np.maximum(both, 1e-12)
        change = np.clip(_WEIGHT * (share - _EVEN), 0.0, _MOST)
        return np.asarray(one_thing(contacts) + change)

    def _asked(self, contacts: Contacts) -> _Answers:
        """Return what the model says of the regions that touch others."""
        numbers = np.unique(contacts.pairs)
        count, order = len(numbers), np.argsort(contacts.regions, kind="stable")
        members = order[np.searchsorted(contacts.regions[order], numbers)]
        of_region = np.full(int(contacts.regions.max()) + 1, -1)
        of_region[numbers] = np.arange(count)
        taken, shown = np.zeros((count, count)), np.zeros((count, count))
        for view in self._views:
            drawn, rows = drawn_part(self._scene, view)
            rgb = self._renderer.render(drawn, view.camera).rgb
            seen = self._seen(drawn, rows, view, of_region[contacts.regions])
            pixels = np.bincount(seen[seen >= 0], minlength=count)
            for number in np.flatnonzero(pixels >= _MIN_PIXELS).tolist():
                points = middle_points(seen == number, _CLICKS)
                found = self._model.propose(rgb, Prompt(points=points, inside=np.ones(len(points), np.bool_)))
                inside = [np.bincount(seen[(logits > 0) & (seen >= 0)], minlength=count) for logits in found.logits]
                covered = np.array([mask[number] for mask in inside]) / pixels[number]
                weights = np.power(np.maximum(found.scores, 0) * covered, _SHARPNESS)
                if weights.sum() > 0:
                    # A region that shows more says more.
                    taken[number] += pixels[number] * (weights @ np.array(inside)) / weights.sum()
                    shown[number] += pixels[number] * pixels
        return _Answers(members, taken, shown)

    def _seen(self, drawn: Gaussians, rows: IntArray, view: Viewpoint, numbers: IntArray) -> IntArray:
        """Return which of the numbers of the surface's Gaussians (S,) each pixel shows, -1 for none, (H, W)."""
        camera = view.camera
        of_row = np.full(len(self._scene), -1)
        of_row[self._surface.rows] = numbers
        y, x = np.indices((camera.height, camera.width))
        first = self._renderer.top_contributors(drawn, camera, np.column_stack([x.ravel(), y.ravel()]), 1)[0][:, 0]
        return np.where(first >= 0, of_row[rows[first]], -1).reshape(camera.height, camera.width)
