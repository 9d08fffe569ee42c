"""Correcting the coarse labels in 3D before any picture is segmented.

A rough selection is mostly right, and where it is wrong, Gaussians that lie near each other and look alike carry
different labels. This stage is mean-field inference in a conditional random field over the visible Gaussians: a
Gaussian follows its neighbours in the joint space of place and colour, the colours typical of the object and of its
surroundings, and its own coarse label, which is trusted the more the farther it lies from the selection's boundary.
All views share the result, so the masks drawn from it agree with each other, and no edge has to be found in a picture
that the Gaussians know already.

The mean-field update is that of Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian
Edge Potentials" (NeurIPS 2011), with its Gaussian kernel over place and colour cut to the nearest neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.support_plane import SupportConfig, find_support
from gaussian_trimmer.segmentation.attached_pieces import attached_to_object
from gaussian_trimmer.settings import Range, Weight

_BINS = 32
# Blurring by one bin's standard deviation, cut at three, as a matrix.
_STEPS = np.arange(_BINS) - np.arange(_BINS)[:, None]
_BLUR = np.where(np.abs(_STEPS) <= 3, np.exp(-0.5 * _STEPS.astype(np.float64) ** 2), 0.0)
_LEAST_WEIGHT = 0.05
_LARGEST_WEIGHT = 20.0
_MAJORITY_OF = 17
_COLOUR_LIMIT = 2.0
_DEEPEST = 1.5
"""Depths behind the boundary from which trust no longer grows."""
_Neighbours = Annotated[int, Range(1, 256)]
_Width = Annotated[float, Range(1e-3, 100)]


@dataclass(frozen=True)
class LabelFieldConfig:
    """How coarse labels are corrected over Gaussians that are alike in place and colour."""

    enabled: bool = True
    """Correct the labels; off, the coarse selection alone tells where the object is expected."""
    passes: Annotated[int, Range(1, 100)] = 2
    """How often the corrected labels are taken as the coarse ones of another round."""
    iterations: Annotated[int, Range(1, 1000)] = 5
    """Mean-field updates a round."""
    neighbours: _Neighbours = 32
    """Nearest neighbours in place and colour that a Gaussian follows."""
    hidden_neighbours: _Neighbours = 8
    """Nearest visible Gaussians in place that one which no view shows follows."""
    place_sigma: _Width = 0.12
    """Standard deviation of the kernel over place, relative to the object's radius."""
    colour_sigma: _Width = 0.08
    """Standard deviation of the kernel over colour, for channels in [0, 1]."""
    smoothness: Weight = 4.0
    """Weight of the neighbours' mean label."""
    colour: Weight = 1.3
    """Weight of the colour models' log-likelihood ratio where they tell object and surroundings apart perfectly."""
    trust: Weight = 1.0
    """Weight of the coarse label at the selection's boundary."""
    depth_trust: Weight = 2.0
    """Weight of the coarse label gained per squared `depth` of distance from the boundary, up to 1.5 depths."""
    depth: _Width = 0.12
    """Distance over which trust grows, relative to the object's radius."""
    attached: Weight = 3.0
    """Weight for the object of what stands in one piece with it on the supporting surface."""
    resting: Weight = 1.0
    """Weight against the object of selected Gaussians in the supporting surface."""
    support: SupportConfig = field(default_factory=SupportConfig)


def correct_labels(
    gaussians: Gaussians, selection: BoolArray, visible: FloatArray, bounds: Bounds, config: LabelFieldConfig
) -> FloatArray:
    """Probability of every Gaussian to belong to the object, (N,).

    Args:
        gaussians: the coarse object and its neighbours.
        selection: the coarse labels, (N,).
        visible: blend weight of each Gaussian summed over the views, in pixels of five views of 512 x 512, (N,).
        bounds: the object's robust bounds.
        config: weights of the terms.

    Gaussians that no view shows take a third of their probability from their coarse label and the rest from the visible
    Gaussians around them: what lies hidden inside an object would stay behind as its ghost, and what lies hidden in
    the table below it would come along.
    """
    probability = selection.astype(np.float32)
    seen = np.flatnonzero(visible > _LEAST_WEIGHT)
    labels = selection[seen]
    if not config.enabled or labels.all() or not labels.any():
        return probability
    places = gaussians.means[seen] / np.float32(bounds.radius)
    colours = np.clip(0.5 + SH_C0 * gaussians.sh_dc[seen], 0, 1).astype(np.float32)
    graph = _Field(places, colours, visible[seen].astype(np.float64), bounds, config)
    for _ in range(config.passes):
        likely = graph.infer(labels)
        labels = likely > 0.5
        if labels.all() or not labels.any():
            break
    probability[seen] = likely
    unseen = np.flatnonzero(visible <= _LEAST_WEIGHT)
    _, near = nearest(
        places, gaussians.means[unseen] / np.float32(bounds.radius), min(config.hidden_neighbours, len(seen))
    )
    around = likely[near].mean(axis=1)
    probability[unseen] = (probability[unseen] + 2 * around) / 3
    return probability


class _Field:
    """The graph over the visible Gaussians, built once for all rounds."""

    def __init__(
        self, places: FloatArray, colours: FloatArray, weights: Float64Array, bounds: Bounds, config: LabelFieldConfig
    ) -> None:
        self.places, self.weights, self.bounds, self.config = places, weights, bounds, config
        capped = np.minimum(weights, _LARGEST_WEIGHT)
        features = np.concatenate([places / config.place_sigma, colours / config.colour_sigma], axis=1)
        squared, self.alike = _others(features, config.neighbours)
        kernel = np.exp(-0.5 * squared) * capped[self.alike]
        self.kernel = (kernel / (kernel.sum(axis=1, keepdims=True) + 1e-9)).astype(np.float32)
        squared, self.near = nearest(places, places, min(_MAJORITY_OF, len(places)))
        self.spacing = np.sqrt(squared[:, min(1, squared.shape[1] - 1)])
        self.near_weights = capped[self.near]
        bins = np.minimum((colours * _BINS).astype(np.int64), _BINS - 1)
        self.colour_bins = (bins[:, 0] * _BINS + bins[:, 1]) * _BINS + bins[:, 2]

    def infer(self, labels: BoolArray) -> FloatArray:
        """One round of mean-field inference from labels (S,), as probabilities (S,)."""
        config = self.config
        signs = np.where(labels, 1.0, -1.0).astype(np.float32)
        unary = self._trust(labels, signs)
        _, separation = self._colour_evidence(labels.astype(np.float64))
        colour_weight = config.colour * float(np.clip((separation - 0.5) / 0.45, 0, 1)) ** 2
        mean = np.sign(unary)  # What stands in one piece with the object starts on its side.
        for _ in range(config.iterations):
            evidence, _ = self._colour_evidence(0.5 * (mean + 1.0))
            followed = np.einsum("nk,nk->n", self.kernel, mean[self.alike])
            mean = np.tanh(0.5 * (unary + config.smoothness * followed + colour_weight * evidence)).astype(np.float32)
        return np.asarray(0.5 * (mean + 1), np.float32)

    def _trust(self, labels: BoolArray, signs: FloatArray) -> FloatArray:
        """Log-odds of each Gaussian by its own label, its depth behind the boundary and the surface below, (S,)."""
        config = self.config
        deep = np.minimum(self._distance_to_boundary(signs, _DEEPEST * config.depth) / config.depth, _DEEPEST)
        unary = np.asarray((config.trust + config.depth_trust * deep**2) * signs, np.float32)
        support = find_support(self.places, labels, self.weights, self.bounds, config.support)
        if support is None:
            return unary
        attached = attached_to_object(self.places, self.spacing, labels, self.weights, support, config.support)
        unary = np.where(attached, config.attached - config.trust, unary)
        resting = support.on_surface & labels
        return np.asarray(np.where(resting, np.minimum(unary, config.trust) - config.resting, unary), np.float32)

    def _distance_to_boundary(self, signs: FloatArray, reach: float) -> FloatArray:
        """Distance of each Gaussian to the nearest of the other side, infinite from `reach` on, (S,).

        The sides are local majorities of the labels. Where one side has all, there is no boundary, and the distance 0.
        """
        majority = np.sum(signs[self.near] * self.near_weights, axis=1) > 0
        distance = np.zeros(len(signs), np.float32)
        if majority.any() and not majority.all():
            for side in (True, False):
                squared, _ = nearest(self.places[majority != side], self.places[majority == side], 1, reach)
                distance[majority == side] = np.sqrt(squared[:, 0])
        return distance

    def _colour_evidence(self, object_share: NDArray[np.floating]) -> tuple[Float64Array, float]:
        """Clipped log-likelihood ratio of each Gaussian's colour (S,), and how well it tells the labels apart.

        The models are blurred colour histograms of object and surroundings, weighted by visibility. The second value is
        the balanced accuracy of the ratio's sign against the labels, 0.5 for colours that tell nothing.
        """
        inside, outside = self.weights * object_share, self.weights * (1 - object_share)
        models = [_blurred_histogram(self.colour_bins, weights) for weights in (inside, outside)]
        ratio = np.log((models[0] + 1e-5) / (models[1] + 1e-5))[self.colour_bins]
        hits = inside @ (ratio > 0) / max(inside.sum(), 1e-12), outside @ (ratio < 0) / max(outside.sum(), 1e-12)
        return np.clip(ratio, -_COLOUR_LIMIT, _COLOUR_LIMIT), float(np.mean(hits))


def _others(features: FloatArray, k: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """The k nearest others of each point: squared distances and indices, (S, k); fewer where there are not so many."""
    k = min(k, len(features) - 1)
    squared, indices = nearest(features, features, k + 1)
    return squared[:, 1:], indices[:, 1:]


def _blurred_histogram(bins: NDArray[np.int64], weights: Float64Array) -> Float64Array:
    """Normalised colour histogram, blurred by one bin's standard deviation, flat."""
    counts = np.bincount(bins, weights, _BINS**3).reshape((_BINS,) * 3)
    for _ in range(3):  # The last axis is blurred and comes first, so that after three times all are in order again.
        counts = np.tensordot(_BLUR, counts, axes=(1, 2))
    return np.asarray((counts / max(counts.sum(), 1e-12)).reshape(-1))
