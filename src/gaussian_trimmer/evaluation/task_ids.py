"""The ids of the tasks' objects where a method keeps several objects in one file.

A CSV file names them task by task. OpenGaussian finds them by words: `cluster_lang.npz` has a CLIP feature for each
cluster of Gaussians, and `text_features.json` one for each object's words.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.layouts import DatasetTask
from gaussian_trimmer.evaluation.predictions import Prediction, last_iteration
from gaussian_trimmer.gaussians import FloatArray, IntArray
from gaussian_trimmer.io.reading import file_bytes, is_file, reading
from gaussian_trimmer.selection_files.kinds import CLUSTERS
from gaussian_trimmer.selection_files.selection_file import open_selection

Ids = dict[str, tuple[int, ...]]
"""Name of a task -> ids of its object."""
_NUMBER = re.compile(r"-?\d{1,10}")
_MAX_CSV_BYTES, _MAX_JSON_BYTES = 1 << 20, 1 << 26
_LEAST_SEEN, _CANDIDATES, _SAME_OBJECT = 5, 10, 0.9
"""OpenGaussian's rule: views in which a cluster must have been seen, how many clusters are considered, and up to which
distance of their own features they are the same object."""


@dataclass(frozen=True, eq=False)
class WordedClusters:
    """What OpenGaussian says of its K clusters of Gaussians, each part of one of R larger ones."""

    language: FloatArray
    """CLIP feature of each cluster, (K, D); zero for those that were hardly seen."""
    centres: FloatArray
    """The feature by which Gaussians belong to it, (K, F)."""
    roots: int
    """R."""
    present: IntArray
    """Ids that some Gaussian has."""

    def called(self, feature: FloatArray) -> tuple[int, ...]:
        """The clusters that words (D,) call, by OpenGaussian's own rule; of these, the ones that some Gaussian has.

        The first is the one whose feature is most like the words'. Of the nine next, those count whose centres are near
        to its own, and whose numbers exceed its own by less than the clusters in a larger one.
        """
        likeness = _unit(self.language) @ _unit(feature[None])[0]
        order = np.argsort(-likeness, kind="stable")[:_CANDIDATES]
        near = np.linalg.norm(self.centres[order] - self.centres[order[0]], axis=1) < _SAME_OBJECT
        same = near & (order - order[0] < len(self.language) / self.roots)
        same[0] = True
        return tuple(int(i) for i in order[same] if i in self.present)


def ids_of_tasks(file: Path, tasks: Sequence[DatasetTask], predictions: Sequence[Prediction]) -> Ids:
    """The ids of the tasks' objects.

    Args:
        file: CSV file of tasks and ids, or JSON file with features of the objects' words.
        tasks: the tasks.
        predictions: the files of each.

    Raises:
        InputError: the file cannot be read, or lacks a task.
    """
    if not is_file(file):
        raise InputError(f"There is no file '{file}'.")
    if file.suffix.lower() != ".json":
        ids = _read_table(file)
        if missing := [task.name for task in tasks if task.name not in ids]:
            raise InputError(f"'{file}' has no row of the task '{clip_name(missing[0])}'.")
        return ids
    words, found = _read_words(file), {}
    for task, prediction in zip(tasks, predictions, strict=True):
        if task.object not in words:
            raise InputError(f"'{file}' has no feature of the words '{clip_name(task.object)}'.")
        clusters = read_clusters(prediction.selection)
        if clusters.language.shape[1:] != words[task.object].shape:
            raise InputError(
                f"The features of words in '{file}' have another length than those in '{prediction.selection}'; give "
                "those of the same CLIP."
            )
        found[task.name] = clusters.called(words[task.object])
        if not found[task.name]:
            raise InputError(f"No Gaussian of '{prediction.selection}' is called by '{clip_name(task.object)}'.")
    return found


def read_clusters(path: Path) -> WordedClusters:
    """The clusters in OpenGaussian's `cluster_lang.npz`, with the codebooks in the folder of the training beside it.

    Raises:
        InputError: a file is missing, or holds something else.
    """
    arrays = open_selection(path).arrays
    books = [_codebook(path.parent, name) for name in ("leaf_code_book", "root_code_book")]
    try:
        language, seen = np.asarray(arrays["leaf_feat"], np.float32), arrays["occu_count"].reshape(-1)
        found = WordedClusters(
            np.where(seen[:, None] < _LEAST_SEEN, np.float32(0), language), books[0], len(books[1]),
            np.unique(arrays[CLUSTERS]),
        )  # fmt: skip
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(
            f"'{path}' is not a cluster_lang.npz of OpenGaussian, with leaf_feat, occu_count and {CLUSTERS}; name the "
            "ids "
            "in a CSV file."
        ) from error
    if language.ndim != 2 or len(books[0]) != len(language) or not len(books[1]):
        raise InputError(f"'{path}' has {len(language)} clusters, and the code book beside it {len(books[0])}.")
    return found


def _codebook(folder: Path, name: str) -> FloatArray:
    files = last_iteration(sorted(folder.glob(f"point_cloud/iteration_*/{name}/kmeans_centers.pth")))
    if not files:
        raise InputError(
            f"'{folder}' has no 'point_cloud/iteration_*/{name}/kmeans_centers.pth', by which OpenGaussian finds what "
            "words call; name the ids in a CSV file."
        )
    arrays = open_selection(files[0]).arrays
    centres = arrays.get("ins_feat", next(iter(arrays.values()), np.zeros(0)))
    if centres.ndim != 2:
        raise InputError(f"'{files[0]}' holds no centres of clusters.")
    return np.asarray(centres, np.float32)


def _read_table(file: Path) -> Ids:
    with reading(file):
        text = file_bytes(file, _MAX_CSV_BYTES).decode("utf-8-sig", "replace")
    rows = [[word.strip() for word in row] for row in csv.reader(text.splitlines()) if any(row)]
    if rows and rows[0][0].lower() == "task":
        del rows[0]
    found: Ids = {}
    for task, *words in rows:
        numbers = " ".join(words).replace(";", " ").split()
        if not numbers or not all(_NUMBER.fullmatch(number) for number in numbers):
            raise InputError(f"'{file}' has a row '{clip_name(task)}' without ids; rows are a task and its ids.")
        found[task] = tuple(map(int, numbers))
    return found


def _read_words(file: Path) -> dict[str, FloatArray]:
    with reading(file):
        data = file_bytes(file, _MAX_JSON_BYTES)
    try:
        words = {str(name): np.array(values, np.float32) for name, values in json.loads(data).items()}
        if not all(feature.ndim == 1 and np.isfinite(feature).all() for feature in words.values()):
            raise ValueError("features of no length")
    except (AttributeError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise InputError(
            f"'{file}' holds no features of words, as OpenGaussian's text_features.json does: an object of lists of "
            "numbers by words."
        ) from error
    return words


def _unit(features: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(features, axis=1, keepdims=True)
    return np.asarray(features / np.maximum(lengths, 1e-12))
