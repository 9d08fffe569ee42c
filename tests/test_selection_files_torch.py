"""Selections in torch files; those that torch itself must have written come last."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzz.torch_archives import torch_file
from selection_builders import (
    checkpoint_entries,
    checkpoint_state,
    classifier_state,
    identity_columns,
    make_scene,
    rows_mask,
    save_ply,
)

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

N = 12
IDS = [0, 1, 1, 2, 0, 1, 0, 0, 2, 0, 0, 0]
SCENE = make_scene(N)


def save(path: Path, value) -> Path:
    path.write_bytes(torch_file(value))
    return path


def select(path: Path, scene=SCENE, **options) -> list[int]:
    return np.flatnonzero(load_selection(path, scene, SelectionOptions(**options))).tolist()


class TestClassifier:
    def scene(self, tmp_path):
        return formats.read(save_ply(tmp_path / "point_cloud.ply", make_scene(N, extras=identity_columns(IDS))))

    def classifier(self, tmp_path, bias=0.0, n=8, width=16):
        weight, biases = np.eye(n, width, dtype=np.float32)[:, :, None, None], np.zeros(n, np.float32)
        biases[1] = bias
        return save(tmp_path / "classifier.pth", {"weight": weight, "bias": biases})

    def test_ids_and_threshold(self, tmp_path):
        path, scene = self.classifier(tmp_path), self.scene(tmp_path)
        assert select(path, scene, object_id=(1, 2)) == [1, 2, 3, 5, 8]
        assert select(tmp_path / "point_cloud.ply", scene, classifier=path, object_id=(2,)) == [3, 8]
        # A logit of 4 among eight has the probability e^4 / (e^4 + 7) = 0.886.
        assert select(path, scene, object_id=(2,), threshold=0.88) == [3, 8]
        with pytest.raises(InputError, match="no Gaussians of object 2"):
            select(path, scene, object_id=(2,), threshold=0.89)
        assert select(self.classifier(tmp_path, bias=100), scene, object_id=(1,)) == list(range(N))

    def test_unified_lift(self, tmp_path):
        path = save(tmp_path / "classifier.pth", np.eye(256, 16, dtype=np.float32))
        # With 256 classes the softmax of a logit of 4 is 0.176.
        assert select(path, self.scene(tmp_path), object_id=(1,), threshold=0.1) == [1, 2, 5]

    def test_ids_are_listed(self, tmp_path):
        path, scene = self.classifier(tmp_path), self.scene(tmp_path)
        for wanted in ((), (7,)):
            with pytest.raises(InputError, match=r"0 \(7\), 1 \(3\), 2 \(2\)\.$"):
                select(path, scene, object_id=wanted)

    def test_what_does_not_fit_is_refused(self, tmp_path):
        scene = self.scene(tmp_path)
        with pytest.raises(InputError, match="scene has no identity features"):
            select(self.classifier(tmp_path), object_id=(1,))
        mask = save(tmp_path / "mask.pt", rows_mask(N, 1))
        with pytest.raises(InputError, match=r"'mask.pt' holds no classifier"):
            select(tmp_path / "point_cloud.ply", scene, classifier=mask, object_id=(1,))
        with pytest.raises(InputError, match="classifies 8 features, but a Gaussian has 16"):
            select(self.classifier(tmp_path, width=8), scene, object_id=(1,))


class TestCheckpoint:
    def save(self, tmp_path, extra=None):
        return save(tmp_path / "chkpnt30000.pth", (checkpoint_entries(SCENE, extra), 30_000))

    def test_logits_and_rows_follow_the_scene(self, tmp_path):
        logits = np.full(N, 2.0, np.float32)  # sigmoid 0.881
        logits[[4, 6]] = 2.3  # sigmoid 0.909
        path = self.save(tmp_path, logits)
        assert select(path) == [4, 6]
        assert select(path, threshold=0.5) == list(range(N))
        assert select(path, SCENE.select(np.arange(N)[::-1].copy())) == [N - 7, N - 5]
        with pytest.raises(InputError, match=r"12 of the 12 rows .* match no row of the scene exactly"):
            select(path, make_scene(9, seed=4), threshold=0.5)

    def test_features(self, tmp_path):
        features = np.column_stack(list(identity_columns(IDS).values()))[:, None]
        path = self.save(tmp_path, features)
        assert select(path, classifier=TestClassifier().classifier(tmp_path), object_id=(2,)) == [3, 8]
        assert select(path, query_row=5) == [1, 2, 5]
        with pytest.raises(InputError, match=r"add --set selection\.classifier"):
            select(path)

    def test_others_hold_no_selection(self, tmp_path):
        with pytest.raises(InputError, match=r"language features \(12, 3\).*numpy\.save"):
            select(self.save(tmp_path, np.zeros((N, 3), np.float32)))
        with pytest.raises(InputError, match="plain 3D Gaussian Splatting"):
            select(self.save(tmp_path))
        with pytest.raises(InputError, match="entries 1 to 6 are not all tensors"):
            select(save(tmp_path / "chkpnt.pth", tuple(range(12))))
        state = list(checkpoint_entries(SCENE))
        state[3] = np.zeros((N, 4, 3), np.float32)
        with pytest.raises(InputError, match="not a checkpoint"):
            select(save(tmp_path / "chkpnt.pth", tuple(state)))


class TestFlashSplat:
    def test_bias_of_the_background(self, tmp_path):
        weights = np.array([[1.0] * N, [0.8] * N], np.float32)
        weights[:, 7] = 0.0
        path = save(tmp_path / "view_num_010_objnum_001.pth", weights)
        # Normalised: 0.781 and 0.625. Row 7 was never seen and stays background.
        assert select(path, gamma=-0.17) == [i for i in range(N) if i != 7]
        assert select(path, object_id=(0,)) == list(range(N))
        with pytest.raises(InputError, match="no Gaussians of object 1"):
            select(path, gamma=-0.15)

    def test_several_objects(self, tmp_path):
        path = save(tmp_path / "view_num_010_objnum_003.pth", np.eye(4, dtype=np.float32)[IDS].T + np.float32(0.1))
        assert select(path, object_id=(1,)) == [1, 2, 5]
        with pytest.raises(InputError, match=r"0 \(7\), 1 \(3\), 2 \(2\)"):
            select(path)
        other = save(tmp_path / "other.pth", np.ones((2, 9), np.float32))
        with pytest.raises(InputError, match=r"shape \(objects \+ 1, 12\) but \(2, 9\)"):
            select(other, kind="flashsplat")


class _Bad:
    def __reduce__(self):
        return (print, ("this must never be printed",))


@pytest.mark.needs("torch")
class TestWrittenByTorch:
    def save(self, path: Path, value, **options) -> Path:
        import torch

        torch.save(value, path, **options)
        return path

    def test_tensors(self, tmp_path):
        import torch

        for shape in ((N,), (N, 1)):
            mask = torch.tensor(rows_mask(N, 1, 8)).reshape(shape)
            assert select(self.save(tmp_path / "mask.pt", {"mask": mask, "name": "cup"})) == [1, 8]
        scores = torch.linspace(0, 1, N).to(torch.bfloat16)
        assert select(self.save(tmp_path / "scores.pt", scores), threshold=0.8) == [9, 10, 11]

    def test_classifier_and_checkpoint(self, tmp_path):
        import torch

        scene = make_scene(N, extras=identity_columns(IDS))
        assert select(self.save(tmp_path / "a.pth", classifier_state(8)), scene, object_id=(1,)) == [1, 2, 5]
        logits = torch.nn.Parameter(torch.where(torch.arange(N) < 2, 5.0, -5.0))
        path = self.save(tmp_path / "chkpnt.pth", (checkpoint_state(SCENE, logits), 7000))
        assert select(path) == [0, 1]
        gaussians = formats.read(path)
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            assert np.array_equal(getattr(gaussians, name), getattr(SCENE, name)), name

    def test_objects_are_refused_and_not_run(self, tmp_path, capsys):
        for value in (_Bad(), (np.zeros(3), _Bad()), {"mask": _Bad()}):
            with pytest.raises(InputError, match="not loaded because they can run code"):
                select(self.save(tmp_path / "bad.pt", value))
        assert capsys.readouterr().out == ""

    def test_the_old_format_and_damage(self, tmp_path):
        import torch

        mask = torch.tensor(rows_mask(N, 1))
        self.save(tmp_path / "old.pt", mask, _use_new_zipfile_serialization=False)
        path = self.save(tmp_path / "mask.pt", mask)
        path.write_bytes(path.read_bytes()[:-40])
        for name in ("old.pt", "mask.pt"):
            with pytest.raises(InputError, match="not a torch file"):
                select(tmp_path / name)
