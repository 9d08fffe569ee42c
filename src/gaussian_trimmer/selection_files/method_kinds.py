"""Selections by what a method found for each Gaussian: identity features, a foreground logit, weights of labels.

Features select with the linear classifier that was trained on them, or like those of one Gaussian.

Gaussian Grouping and OmniSeg3D-GS save 16 features a Gaussian as obj_dc_0 .. obj_dc_15, or as entry 7 of a
checkpoint. `classifier.pth` is the state of a 1 x 1 convolution, weight (K, 16, 1, 1) and bias (K,); Unified-Lift's is
a bare weight (256, 16). In COB-GS's checkpoint `chkpnt<iteration>.pth`, entry 7 is a foreground logit.
FlashSplat's `view_num_*_objnum_*.pth` holds the blend weights of every Gaussian, summed by the label of the pixel; row
0 is the background.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, mask_of_rows, sigmoid
from gaussian_trimmer.io.reading import LARGEST
from gaussian_trimmer.selection_files.kinds import check_ids, select_ids
from gaussian_trimmer.selection_files.row_matching import identity_features
from gaussian_trimmer.selection_files.selection_file import SelectionFile, SelectionOptions, flag, open_selection

_PROBABILITY = 0.3
"""Gaussian Grouping's threshold on the softmax."""
_SIMILARITY = 0.9
"""Default threshold on (cos + 1) / 2, as in OmniSeg3D-GS's interface."""
_FOREGROUND = 0.9
"""COB-GS's threshold on the sigmoid."""
_FEATURES = 16
_PROBABILITIES_AT_ONCE = 1 << 22
_LARGEST_WEIGHT = 1e30
_OBJECTS_AT_ONCE = 16


@np.errstate(over="ignore", invalid="ignore")  # what becomes infinite is found where it is used
def classifier_of(file: SelectionFile) -> tuple[FloatArray, FloatArray] | None:
    """Return weight (K, D) and bias (K,) of the linear classifier that a file holds, or None if it holds none."""
    if "weight" in file.arrays:
        weight, bias = file.arrays["weight"], file.arrays.get("bias")
    elif len(file.arrays) == 1:
        weight, bias = next(iter(file.arrays.values())), None
        if weight.shape[1:] != (_FEATURES,):
            return None
    else:
        return None
    if weight.dtype.kind != "f" or weight.ndim < 2 or weight.shape[2:] not in ((), (1,), (1, 1)):
        return None
    weight = np.asarray(weight.reshape(weight.shape[:2]), np.float32)
    bias = np.zeros(len(weight), np.float32) if bias is None else np.asarray(bias, np.float32)
    return (weight, bias) if bias.shape == (len(weight),) else None


def select_classifier(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians that the classifier gives one of the chosen ids with a probability above the threshold, (N,).

    Raises:
        InputError: features or classifier are missing or do not fit each other, or the ids are not chosen or absent.
    """
    source = file if options.classifier is None else open_selection(options.classifier, len(gaussians))
    classifier = classifier_of(source)
    if classifier is None:
        raise InputError(
            f"'{source.path.name}' holds no classifier of identity features; give the method's classifier.pth with "
            f"{flag('classifier')}."
        )
    weight, bias = classifier
    if not all((np.abs(values) <= LARGEST).all() for values in classifier):
        raise InputError(f"'{source.path.name}' holds weights that are NaN, infinite or huge; train again.")
    features, rows = _features_and_rows(file, gaussians)
    if features.shape[1] != weight.shape[1]:
        raise InputError(
            f"'{source.path.name}' classifies {weight.shape[1]} features, but a Gaussian has "
            f"{features.shape[1]}; give the classifier of the same training."
        )
    threshold = _PROBABILITY if options.threshold is None else options.threshold
    ids = range(len(bias))
    counts, chosen = np.zeros(len(ids), np.int64), np.zeros(len(features), np.bool_)
    step = max(1, min(1 << 14, _PROBABILITIES_AT_ONCE // max(1, len(ids))))
    for start in range(0, len(features), step):
        logits = features[start : start + step] @ weight.T + bias
        odds = np.exp(logits - logits.max(axis=1, keepdims=True))
        likely = odds / odds.sum(axis=1, keepdims=True) > threshold
        counts += likely.sum(axis=0)
        chosen[start : start + step] = likely[:, [i for i in options.object_id if i in ids]].any(axis=1)
    check_ids(options.object_id, ids, counts.tolist(), source.path)
    return mask_of_rows(rows[chosen], len(gaussians))


def select_similarity(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the Gaussians for which (cos + 1) / 2 of their and the query's features is above the threshold, (N,).

    A feature of length zero has the cosine 0 with every other.

    Raises:
        InputError: there are no features, no query is given, or it is not a row of the scene and of the file.
    """
    features, rows = _features_and_rows(file, gaussians)
    if options.query_row is None:
        raise InputError(f"Name a Gaussian on the object by its row number with {flag('query_row')}.")
    at = np.flatnonzero(rows == options.query_row)
    if len(at) == 0:
        raise InputError(
            f"The query row {options.query_row} has no features in '{file.path.name}'; choose a row of the scene from "
            f"0 to {len(gaussians) - 1} that the file holds."
        )
    unit = features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), np.float32(1e-12))
    scores = (unit @ unit[at[0]] + 1) / 2
    threshold = _SIMILARITY if options.threshold is None else options.threshold
    return mask_of_rows(rows[scores > threshold], len(gaussians))


def select_checkpoint(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the Gaussians whose foreground probability is above the threshold, (N,).

    Raises:
        InputError: the checkpoint holds no logits, or its Gaussians are not the scene's.
    """
    name = file.path.name
    if file.checkpoint is None or file.checkpoint.extra is None:
        raise InputError(
            f"'{name}' is not a checkpoint that holds a selection, as those of plain 3D Gaussian Splatting."
        )
    if file.has_features:
        raise InputError(
            f"'{name}' holds identity features; add {flag('classifier', 'classifier.pth')} and {flag('object_id')}, or "
            f"{flag('query_row')}."
        )
    if file.checkpoint.logits is None:
        raise InputError(
            f"'{name}' holds language features {file.checkpoint.extra.shape}, which select no Gaussians (LangSplat "
            "answers a query with masks of images); lift such masks to the scene with 'gaussian-trimmer select', "
            f"or save a score for each Gaussian with numpy.save and choose {flag('threshold')}."
        )
    probabilities = sigmoid(np.asarray(file.checkpoint.logits, np.float32))
    chosen = probabilities > (_FOREGROUND if options.threshold is None else options.threshold)
    try:
        return mask_of_rows(file.scene_rows(gaussians)[chosen], len(gaussians))
    except InputError as error:
        raise InputError(f"{error} COB-GS and NG-GS split Gaussians: give '{name}' for the scene as well.") from error


def _features_and_rows(file: SelectionFile, gaussians: Gaussians) -> tuple[FloatArray, IntArray]:
    """Identity features (M, D) of the file, or else of the scene, with their scene rows (M,).

    Raises:
        InputError: neither has features, they are not finite, or the file's Gaussians are not the scene's.
    """
    own = file.features
    features = identity_features(gaussians.extras) if own is None else own
    if features is None:
        raise InputError(
            "The scene has no identity features obj_dc_0, obj_dc_1, ...; give the PLY that the method wrote as the "
            "scene."
        )
    if not (np.abs(features) <= LARGEST).all():
        raise InputError(
            f"'{file.path.name}' is used with identity features that are NaN, infinite or huge; train again."
        )
    return features, np.arange(len(gaussians)) if own is None else file.scene_rows(gaussians)


def flashsplat_weights(file: SelectionFile) -> NDArray[Any] | None:
    """Return the weights (L, M) that FlashSplat saves, if the file holds such an array."""
    if len(file.arrays) != 1:
        return None
    weights = next(iter(file.arrays.values()))
    return weights if weights.ndim == 2 and weights.dtype.kind == "f" and len(weights) >= 2 else None


def select_flashsplat(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the Gaussians of the chosen objects, (N,); if there is only one object, it need not be chosen.

    Raises:
        InputError: there are no such weights for N Gaussians, or the objects are not chosen or have no Gaussians.
    """
    weights = flashsplat_weights(file)
    if weights is None or weights.shape[1] != len(gaussians):
        shape = "" if weights is None else f" but {weights.shape}"
        raise InputError(
            f"'{file.path.name}' does not hold weights of shape (objects + 1, {len(gaussians)}){shape}; give the "
            "scene that they were accumulated on."
        )
    if not (np.abs(weights) <= _LARGEST_WEIGHT).all():
        raise InputError(f"'{file.path.name}' holds weights that are NaN, infinite or huge; accumulate them again.")
    wanted = options.object_id or ((1,) if len(weights) == 2 else ())
    numbers = np.arange(1, len(weights))
    found = assign_labels(weights.shape[1], numbers, lambda part: weights[[0, *part]].T, options.gamma)
    return select_ids(found, wanted, file.path)


def assign_labels(
    n: int, numbers: NDArray[Any], weights_of: Callable[[NDArray[Any]], NDArray[Any]], gamma: float = 0.0
) -> NDArray[Any]:
    """Return the number of the object of the largest weight, (N,), 0 for the background, in the type of the numbers.

    The optimal assignment of "FlashSplat: 2D to 3D Gaussian Splatting Segmentation Solved Optimally" (Shen et al.,
    ECCV 2024), section 3: the weights of a Gaussian are scaled to unit length first.

    Args:
        n: number of Gaussians.
        numbers: of the objects, rising, (L,).
        weights_of: gives the blend weights under the background and under some objects, (N, 1 + P), for their numbers
            (P,). It is called with a few at a time: all columns together would not fit into memory.
        gamma: background bias in [-1, 1]: positive values select less, negative ones more.

    Ties go to the background, or to the lower number. Gaussians that no view saw are background whatever gamma is.

    >>> weights = np.array([[3.0, 4.0], [4.0, 3.0], [0.0, 0.0]])
    >>> assign_labels(3, np.array([1]), lambda part: weights).tolist()
    [1, 0, 0]
    >>> assign_labels(3, np.array([1]), lambda part: weights, gamma=-0.3).tolist()
    [1, 1, 0]
    """
    largest, squared_length, winner = np.zeros(n), np.zeros(n), np.zeros(n, numbers.dtype)
    for part in np.array_split(numbers, -(-len(numbers) // _OBJECTS_AT_ONCE)):
        weights = np.asarray(weights_of(part), np.float64)
        background, objects = weights[:, 0], weights[:, 1:]
        squared_length += np.square(objects).sum(axis=1)
        best, most = objects.argmax(axis=1), objects.max(axis=1)
        ahead = most > largest
        winner[ahead], largest[ahead] = part[best[ahead]], most[ahead]
    length = np.sqrt(squared_length + np.square(background))
    length[length == 0] = 1.0
    return np.where(largest / length > background / length + gamma, winner, 0)
