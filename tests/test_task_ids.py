"""Which ids belong to which task: named in a table, or found by words as OpenGaussian finds them."""

import json

import numpy as np
import pytest

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts import DatasetTask
from gaussian_trimmer.evaluation.predictions import Prediction
from gaussian_trimmer.evaluation.task_ids import WordedClusters, ids_of_tasks, read_clusters

CAT, HAT, NOISE = np.eye(3, 8, dtype=np.float32)


def clusters(language, centres, roots=2, present=None):
    present = np.arange(len(language)) if present is None else np.array(present)
    return WordedClusters(np.float32(language), np.float32(centres), roots, present)


class TestClustersByWords:
    def test_the_most_alike_comes_first_and_parts_of_the_same_object_with_it(self):
        language = [HAT, 0.9 * CAT + 0.1 * HAT, CAT + 0.2 * HAT, NOISE]
        centres = [[5, 0], [0, 0], [0.5, 0], [9, 9]]
        assert clusters(language, centres).called(CAT) == (1, 2)
        assert clusters(language, [[5, 0], [0, 0], [0.95, 0], [9, 9]]).called(CAT) == (1,)
        assert clusters(language, centres).called(3 * HAT) == (0,)  # lengths of features do not matter

    def test_numbers_that_lie_a_larger_cluster_above_do_not_count(self):
        language, centres = [CAT, NOISE, CAT + 0.1 * HAT, CAT + 0.2 * HAT], np.zeros((4, 2))
        assert clusters(language, centres, roots=1).called(CAT) == (0, 2, 3, 1)
        assert clusters(language, centres, roots=2).called(CAT) == (0, 1)
        assert clusters(language[::-1], centres, roots=4).called(CAT) == (3, 1, 0, 2)  # below it any does

    def test_only_ten_are_considered_and_only_those_with_gaussians_chosen(self):
        language = [CAT + 0.01 * i * HAT for i in range(12)]
        assert clusters(language, np.zeros((12, 2)), roots=1).called(CAT) == tuple(range(10))
        assert clusters(language, np.zeros((12, 2)), roots=1, present=[3, 11]).called(CAT) == (3,)


@pytest.fixture
def folder(tmp_path):
    """A training of OpenGaussian: six clusters, of which two are the cat and one has hardly been seen."""
    torch = pytest.importorskip("torch", reason="code books are written with torch")
    language = np.stack([HAT, CAT, 2 * CAT, 0.9 * CAT + 0.1 * HAT, NOISE, NOISE])
    np.savez(
        tmp_path / "cluster_lang.npz",
        leaf_feat=language,
        leaf_score=np.ones(6, np.float32),
        occu_count=np.array([9, 9, 4, 9, 9, 9]),
        leaf_ind=np.array([0, 1, 1, 3, 4]),
    )
    for iteration, shift in ((7000, 5.0), (70000, 0.1)):
        place = tmp_path / "point_cloud" / f"iteration_{iteration}"
        for book, centres in (
            ("leaf_code_book", shift * torch.arange(6.0)[:, None]),
            ("root_code_book", torch.ones(2, 6)),
        ):
            (place / book).mkdir(parents=True)
            torch.save({"ins_feat": centres}, place / book / "kmeans_centers.pth")
    (tmp_path / "text_features.json").write_text(json.dumps({"cat": CAT.tolist(), "top hat": HAT.tolist()}))
    return tmp_path


def found(folder, file="text_features.json", words=("cat", "top hat")):
    tasks = [DatasetTask("ramen", word, ()) for word in words]
    files = Prediction(folder / "scene.ply", folder / "cluster_lang.npz", folder)
    return ids_of_tasks(folder / file, tasks, [files] * len(tasks))


@pytest.mark.needs("torch")
class TestOpenGaussian:
    def test_words_name_clusters(self, folder):
        read = read_clusters(folder / "cluster_lang.npz")
        assert read.roots == 2 and not read.language[2].any() and read.present.tolist() == [0, 1, 3, 4]
        assert found(folder) == {"ramen/cat": (1, 3, 0), "ramen/top hat": (0, 1)}

    def test_what_is_missing_or_damaged_is_named(self, folder):
        with pytest.raises(InputError, match="no feature of the words 'dog'"):
            found(folder, words=["dog"])
        (folder / "short.json").write_text('{"cat": [1, 2]}')
        with pytest.raises(InputError, match="another length"):
            found(folder, "short.json", ["cat"])
        for text in ('{"cat": [1, "x"]}', '{"cat": 1}', "[1]", "{", '{"cat": [NaN]}'):
            (folder / "damaged.json").write_text(text)
            with pytest.raises(InputError, match="no features of words"):
                found(folder, "damaged.json", ["cat"])
        np.savez(
            folder / "cluster_lang.npz", leaf_feat=np.ones((3, 8)), occu_count=np.ones(3), leaf_ind=np.ones(3, int)
        )
        with pytest.raises(InputError, match="3 clusters, and the code book beside it 6"):
            found(folder)
        np.savez(folder / "cluster_lang.npz", leaf_ind=np.ones(3, int))
        with pytest.raises(InputError, match=r"not a cluster_lang\.npz of OpenGaussian"):
            found(folder)
        for path in folder.glob("point_cloud/*/root_code_book/*"):
            path.unlink()
        with pytest.raises(InputError, match=r"root_code_book/kmeans_centers\.pth"):
            found(folder)
