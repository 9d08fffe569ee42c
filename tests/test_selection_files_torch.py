from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from selection_builders import (
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

torch = pytest.importorskip("torch", reason="torch files are written with torch")

N = 12
IDS = [0, 1, 1, 2, 0, 1, 0, 0, 2, 0, 0, 0]
SCENE = make_scene(N)


def save(path: Path, value) -> Path:
    torch.save(value, path)
    return path


def select(path: Path, scene=SCENE, **options) -> list[int]:
    return np.flatnonzero(load_selection(path, scene, SelectionOptions(**options))).tolist()


class TestTensors:
    @pytest.mark.parametrize("shape", [(N,), (N, 1)], ids=["SAGA v2", "SAGA v1 and SA3D-GS"])
    def test_boolean_mask(self, tmp_path, shape):
        mask = torch.tensor(rows_mask(N, 1, 8)).reshape(shape)
        assert select(save(tmp_path / "final_mask.pt", mask)) == [1, 8]

    def test_integer_labels_and_half_precision_scores(self, tmp_path):
        assert select(save(tmp_path / "labels.pt", torch.tensor(IDS)), object_id=(2,)) == [3, 8]
        scores = torch.linspace(0, 1, N).to(torch.bfloat16)
        assert select(save(tmp_path / "scores.pt", scores), threshold=0.8) == [9, 10, 11]

    def test_dict_with_a_mask(self, tmp_path):
        assert select(save(tmp_path / "d.pt", {"mask": torch.tensor(rows_mask(N, 4)), "name": "cup"})) == [4]


class TestClassifier:
    def scene(self, tmp_path):
        scene = make_scene(N, extras=identity_columns(IDS))
        return formats.read(save_ply(tmp_path / "point_cloud.ply", scene))

    def test_gaussian_grouping(self, tmp_path):
        path = save(tmp_path / "classifier.pth", classifier_state(8))
        scene = self.scene(tmp_path)
        assert select(path, scene, object_id=(1,)) == [1, 2, 5]
        assert select(path, scene, object_id=(1, 2)) == [1, 2, 3, 5, 8]
        assert select(tmp_path / "point_cloud.ply", scene, classifier=path, object_id=(2,)) == [3, 8]

    def test_bias_and_threshold(self, tmp_path):
        state = classifier_state(8)
        state["bias"][1] = 100.0
        path, scene = save(tmp_path / "classifier.pth", state), self.scene(tmp_path)
        assert select(path, scene, object_id=(1,)) == list(range(N))
        # A logit of 4 among eight has the probability e^4 / (e^4 + 7) = 0.886.
        plain = save(tmp_path / "plain.pth", classifier_state(8))
        assert select(plain, scene, object_id=(2,), threshold=0.88) == [3, 8]
        with pytest.raises(InputError, match="no Gaussians of object 2"):
            select(plain, scene, object_id=(2,), threshold=0.89)

    def test_unified_lift(self, tmp_path):
        path = save(tmp_path / "classifier.pth", torch.eye(256, 16))
        # With 256 classes the softmax of a logit of 4 is 0.176.
        assert select(path, self.scene(tmp_path), object_id=(1,), threshold=0.1) == [1, 2, 5]

    def test_ids_are_listed(self, tmp_path):
        path, scene = save(tmp_path / "classifier.pth", classifier_state(8)), self.scene(tmp_path)
        with pytest.raises(InputError, match=r"ids \(Gaussians\): 0 \(7\), 1 \(3\), 2 \(2\)\.$"):
            select(path, scene)
        with pytest.raises(InputError, match=r"no Gaussians of object 7; .*: 0 \(7\), 1 \(3\), 2 \(2\)\.$"):
            select(path, scene, object_id=(7,))

    def test_scene_without_features(self, tmp_path):
        with pytest.raises(InputError, match="scene has no identity features"):
            select(save(tmp_path / "classifier.pth", classifier_state(8)), object_id=(1,))

    def test_wrong_classifier(self, tmp_path):
        scene = self.scene(tmp_path)
        other = save(tmp_path / "mask.pt", torch.tensor(rows_mask(N, 1)))
        with pytest.raises(InputError, match=r"'mask.pt' holds no classifier"):
            select(tmp_path / "point_cloud.ply", scene, classifier=other, object_id=(1,))
        narrow = save(tmp_path / "narrow.pth", torch.nn.Conv2d(8, 4, 1).state_dict())
        with pytest.raises(InputError, match="classifies 8 features, but a Gaussian has 16"):
            select(narrow, scene, object_id=(1,))


class TestCheckpoint:
    def test_cob_gs(self, tmp_path):
        logits = torch.full((N,), 2.0)  # sigmoid 0.881
        logits[[4, 6]] = 2.3  # sigmoid 0.909
        value = (checkpoint_state(SCENE, torch.nn.Parameter(logits)), 30_000)
        assert len(value[0]) == 13
        path = save(tmp_path / "chkpnt30000.pth", value)
        assert select(path) == [4, 6]
        assert select(path, threshold=0.5) == list(range(N))

    def test_rows_follow_the_scene(self, tmp_path):
        logits = torch.where(torch.arange(N) < 2, 5.0, -5.0)
        path = save(tmp_path / "chkpnt.pth", (checkpoint_state(SCENE, logits), 1))
        assert select(path, SCENE.select(np.arange(N)[::-1].copy())) == [N - 2, N - 1]

    def test_other_gaussians_than_the_scene(self, tmp_path):
        path = save(tmp_path / "chkpnt.pth", (checkpoint_state(SCENE, torch.ones(N)), 1))
        with pytest.raises(InputError, match=r"12 of the 12 rows .* match no row of the scene exactly"):
            select(path, make_scene(9, seed=4), threshold=0.5)

    def test_langsplat_points_to_lifting(self, tmp_path):
        path = save(tmp_path / "chkpnt30000.pth", (checkpoint_state(SCENE, torch.zeros(N, 3)), 30_000))
        with pytest.raises(InputError, match=r"language features \(12, 3\).*lift"):
            select(path)

    def test_plain_checkpoint_holds_no_selection(self, tmp_path):
        state = checkpoint_state(SCENE)
        assert len(state) == 12
        for value in ((state, 7000), state):
            with pytest.raises(InputError, match="plain 3D Gaussian Splatting"):
                select(save(tmp_path / "chkpnt7000.pth", value))

    def test_gaussian_grouping(self, tmp_path):
        features = torch.tensor(np.column_stack(list(identity_columns(IDS).values())))[:, None]
        path = save(tmp_path / "chkpnt30000.pth", (checkpoint_state(SCENE, torch.nn.Parameter(features)), 30_000))
        classifier = save(tmp_path / "classifier.pth", classifier_state(8))
        assert select(path, classifier=classifier, object_id=(2,)) == [3, 8]
        assert select(path, query_row=5) == [1, 2, 5]
        with pytest.raises(InputError, match=r"add --selection\.classifier"):
            select(path)

    def test_gaussians_of_a_checkpoint(self, tmp_path):
        gaussians = formats.read(save(tmp_path / "chkpnt.pth", (checkpoint_state(SCENE), 7000)))
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            assert np.array_equal(getattr(gaussians, name), getattr(SCENE, name)), name

    def test_other_tuples(self, tmp_path):
        with pytest.raises(InputError, match="entries 1 to 6 are not all tensors"):
            select(save(tmp_path / "chkpnt.pth", tuple(range(12))))
        state = list(checkpoint_state(SCENE))
        state[3] = torch.zeros(N, 4, 3)
        with pytest.raises(InputError, match="no checkpoint"):
            select(save(tmp_path / "chkpnt.pth", tuple(state)))


class TestFlashSplat:
    def test_one_object_needs_no_id(self, tmp_path):
        weights = torch.zeros(2, N)
        weights[0] = 1.0
        weights[1, [3, 4]] = 5.0
        weights[:, 7] = 0.0
        path = save(tmp_path / "view_num_010_objnum_001.pth", weights)
        assert select(path) == [3, 4]
        assert select(path, object_id=(0,)) == [0, 1, 2, 5, 6, 7, 8, 9, 10, 11]

    def test_bias_of_the_background(self, tmp_path):
        weights = torch.zeros(2, N)
        weights[0], weights[1] = 1.0, 0.8
        weights[:, 7] = 0.0
        path = save(tmp_path / "view_num_010_objnum_001.pth", weights)
        # Normalised: 0.781 and 0.625. Row 7 was never seen and stays background.
        assert select(path, gamma=-0.17) == [i for i in range(N) if i != 7]
        with pytest.raises(InputError, match="no Gaussians of object 1"):
            select(path, gamma=-0.15)

    def test_several_objects(self, tmp_path):
        weights = torch.nn.functional.one_hot(torch.tensor(IDS), 4).T.float().contiguous() + 0.1
        path = save(tmp_path / "view_num_010_objnum_003.pth", weights)
        assert weights.shape == (4, N)
        assert select(path, object_id=(1,)) == [1, 2, 5]
        with pytest.raises(InputError, match=r"0 \(7\), 1 \(3\), 2 \(2\)"):
            select(path)

    def test_weights_of_another_scene(self, tmp_path):
        path = save(tmp_path / "view_num_010_objnum_001.pth", torch.ones(2, 9))
        with pytest.raises(InputError, match=r"shape \(objects \+ 1, 12\) but \(2, 9\)"):
            select(path, kind="flashsplat")


class _Bad:
    def __reduce__(self):
        return (print, ("this must never be printed",))


class TestHostileFiles:
    @pytest.mark.parametrize("value", [_Bad(), (torch.zeros(3), _Bad()), {"mask": _Bad()}])
    def test_objects_are_refused_and_not_run(self, tmp_path, capsys, value):
        with pytest.raises(InputError, match="not loaded because they can run code"):
            select(save(tmp_path / "bad.pt", value))
        assert capsys.readouterr().out == ""

    def test_the_old_format_and_damage(self, tmp_path):
        path = save(tmp_path / "mask.pt", torch.tensor(rows_mask(N, 1)))
        torch.save(torch.tensor(rows_mask(N, 1)), tmp_path / "old.pt", _use_new_zipfile_serialization=False)
        path.write_bytes(path.read_bytes()[:-40])
        for name in ("old.pt", "mask.pt"):
            with pytest.raises(InputError, match="no torch file of the zip format"):
                select(tmp_path / name)
