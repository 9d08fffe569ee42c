from __future__ import annotations

import numpy as np
import pytest
import toy
from selection_builders import identity_columns, make_scene, save_ply, save_ply_like_sa3d_gs

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import ply
from gaussian_trimmer.gaussians import Gaussians, concatenate
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

N = 12


def select(path, scene: Gaussians, **options) -> list[int]:
    return np.flatnonzero(load_selection(path, scene, SelectionOptions(**options))).tolist()


class TestSubset:
    def test_rows_in_any_order(self, tmp_path):
        scene = make_scene(N)
        assert select(save_ply(tmp_path / "part.ply", scene, [7, 2, 9]), scene) == [2, 7, 9]

    @pytest.mark.parametrize("coefficients", [0, 3, 8])
    def test_fewer_harmonics_than_the_scene(self, tmp_path, coefficients):
        scene = make_scene(N)
        part = scene.replace(sh_rest=scene.sh_rest[:, :, :coefficients])
        assert select(save_ply(tmp_path / "part.ply", part, [4, 1]), scene) == [1, 4]

    def test_without_normals_and_with_negative_zeros(self, tmp_path):
        scene = make_scene(N, coefficients=0)
        scene.sh_dc[3, 1] = 0.0
        names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
        part = np.column_stack([scene.means, scene.sh_dc, scene.opacity_logits]).astype("<f4")[[8, 3]]
        part[1, 4] = -0.0
        header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
        header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        (tmp_path / "part.ply").write_bytes(header.encode() + part.tobytes())
        assert select(tmp_path / "part.ply", scene) == [3, 8]

    def test_equal_rows_pair_off(self, tmp_path):
        scene = make_scene(N)
        twice = concatenate([scene, scene])
        assert select(save_ply(tmp_path / "one.ply", twice, [5]), twice) == [5]
        assert select(save_ply(tmp_path / "two.ply", twice, [5, 5]), twice) == [5, 5 + N]
        notes = []
        load_selection(save_ply(tmp_path / "three.ply", twice, [5, 5, 5]), twice, say=notes.append)
        assert notes == ["three.ply: 1 as parts of split Gaussians"]

    def test_rows_of_another_scene_are_counted(self, tmp_path):
        scene = make_scene(N)
        part = concatenate([scene.select(slice(2, 4)), make_scene(3, seed=1)])
        with pytest.raises(InputError, match=r"3 of the 5 rows of 'part.ply' match no row .*first is row 2"):
            select(save_ply(tmp_path / "part.ply", part), scene)

    def test_whole_scene_is_no_part_of_it(self, tmp_path):
        scene = make_scene(N)
        with pytest.raises(InputError, match="holds 12 Gaussians and the scene 12, so it is not a part"):
            select(save_ply(tmp_path / "all.ply", scene), scene)

    def test_one_changed_bit_is_no_exact_match_and_said(self, tmp_path):
        scene = make_scene(N)
        part = scene.select(np.arange(3, 6))
        part.sh_dc[1, 2] = np.nextafter(part.sh_dc[1, 2], np.float32(9))
        notes = []
        found = load_selection(save_ply(tmp_path / "part.ply", part), scene, say=notes.append)
        assert np.flatnonzero(found).tolist() == [3, 4, 5]
        assert notes == ["part.ply: 1 of 3 rows by the nearest Gaussian"]

    @pytest.mark.parametrize("suffix", [".splat", ".spz", ".sog", ".compressed.ply"])
    def test_cut_outs_of_rounded_formats_in_any_order(self, tmp_path, suffix):
        scene, truth = toy.ball_on_floor()
        rows = np.random.default_rng(0).permutation(np.flatnonzero(truth))
        formats.write(scene.select(rows), tmp_path / f"part{suffix}")
        notes = []
        found = load_selection(tmp_path / f"part{suffix}", scene, say=notes.append)
        assert np.count_nonzero(found & ~truth) <= 2
        assert np.count_nonzero(found & truth) >= 0.98 * truth.sum()
        assert "by the nearest Gaussian" in notes[0]

    def test_children_of_split_gaussians_lead_to_their_parents_and_what_does_not_match_is_counted(self, tmp_path):
        scene, truth = toy.ball_on_floor()
        part = scene.select(truth)
        part.means[:9] += np.float32([0.05, 0, 0])
        part.log_scales[:9, 0] -= np.float32(0.6)
        part.opacity_logits[:9] -= np.float32(0.5)
        notes, far = [], toy.gaussians([[50, 50, 50], [60, 50, 50]], 0.1, toy.BLUE)
        path = save_ply(tmp_path / "object.ply", concatenate([part, far]))
        found = load_selection(path, scene, say=notes.append)
        assert np.count_nonzero(found ^ truth) <= 2
        assert notes == ["object.ply: 9 as parts of split Gaussians", "object.ply: 2 match nothing"]


class TestMovedSubset:
    """SAGD's `point_cloud_seg_gd.ply`: boundary rows have other centres and scales."""

    def moved(self, scene: Gaussians, rows: list[int], n_moved: int) -> Gaussians:
        part = scene.select(np.array(rows))
        part.means[:n_moved] += 0.25
        part.log_scales[:n_moved] -= 0.5
        return part

    def test_moved_rows_keep_their_identity(self, tmp_path):
        scene = make_scene(N)
        path = save_ply(tmp_path / "point_cloud_seg_gd.ply", self.moved(scene, [9, 3, 6, 1], 2))
        assert select(path, scene) == [1, 3, 6, 9]

    def test_unmoved_twin_does_not_confuse(self, tmp_path):
        scene = make_scene(N)
        for array in (scene.sh_dc, scene.sh_rest, scene.opacity_logits, scene.quaternions):
            array[4] = array[8]
        part = self.moved(scene, [8, 4], 1)
        assert select(save_ply(tmp_path / "gd.ply", part), scene) == [4, 8]

    def test_ambiguous_rows_match_nothing(self, tmp_path):
        scene = make_scene(N)
        for array in (scene.sh_dc, scene.sh_rest, scene.opacity_logits, scene.quaternions):
            array[4] = array[8]
        part = self.moved(scene, [8, 2], 1)
        part.means[0] += 9  # too far off from either
        notes = []
        found = load_selection(save_ply(tmp_path / "gd.ply", part), scene, say=notes.append)
        assert (np.flatnonzero(found).tolist(), notes) == ([2], ["gd.ply: 1 match nothing"])


class TestProperty:
    def test_sa3d_gs(self, tmp_path):
        scene = make_scene(N)
        path = save_ply_like_sa3d_gs(tmp_path / "seg_point_cloud.ply", scene, [8, 2, 5, 3], [0.7, -0.1, 0.0, 2.0])
        assert select(path, scene) == [3, 8]
        assert select(path, scene, threshold=1.0) == [3]

    def test_any_property(self, tmp_path):
        scene = make_scene(N, extras={"score": np.linspace(0, 1, N, dtype=np.float32)})
        path = save_ply(tmp_path / "scene.ply", scene, list(range(N))[::-1])
        assert select(path, scene, property="score", threshold=0.75) == [9, 10, 11]
        assert select(path, scene, property="opacity") == np.flatnonzero(scene.opacity_logits > 0).tolist()

    def test_label_property(self, tmp_path):
        labels = np.arange(N, dtype=np.int32) % 3
        scene = make_scene(N, extras={"label": labels})
        path = save_ply(tmp_path / "scene.ply", scene)
        assert select(path, formats.read(path), property="label", object_id=(2,)) == [2, 5, 8, 11]
        with pytest.raises(InputError, match=r"no Gaussians of object 3; .*0 \(4\), 1 \(4\), 2 \(4\)"):
            select(path, scene, property="label", object_id=(3,))
        with pytest.raises(InputError, match=r"'opacity' of 'scene.ply' is not an id"):
            select(path, scene, property="opacity", object_id=(3,))

    def test_unknown_property_lists_the_others(self, tmp_path):
        scene = make_scene(N, extras={"score": np.ones(N, np.float32)})
        with pytest.raises(InputError, match=r"no property 'scor'; .* among: x, y, z, .*score"):
            select(save_ply(tmp_path / "scene.ply", scene), scene, property="scor")

    def test_rows_of_another_scene(self, tmp_path):
        path = save_ply_like_sa3d_gs(tmp_path / "seg.ply", make_scene(N), [1, 2], [1.0, 1.0])
        with pytest.raises(InputError, match="2 of the 2 rows"):
            select(path, make_scene(N, seed=5))


class TestSimilarity:
    IDS: tuple[int, ...] = (0, 1, 1, 2, 0, 1, 0, 0, 2, 0, 0, 0)

    def test_omniseg3d(self, tmp_path):
        scene = make_scene(N, extras=identity_columns(list(self.IDS)))
        path = save_ply(tmp_path / "point_cloud.ply", scene)
        assert select(path, formats.read(path), query_row=2) == [1, 2, 5]
        # Orthogonal features score (0 + 1) / 2.
        assert select(path, scene, query_row=2, threshold=0.49) == list(range(N))

    def test_without_a_query_that_is_a_row_the_options_are_named(self, tmp_path):
        scene = make_scene(N, extras=identity_columns(list(self.IDS)))
        path = save_ply(tmp_path / "scene.ply", scene)
        with pytest.raises(InputError, match=r"query row 12 has no features .* 0 to 11"):
            select(path, scene, query_row=12)
        with pytest.raises(InputError, match=r"use --set selection\.classifier=VALUE or --set selection\.query-row="):
            select(path, scene)
        assert select(save_ply(tmp_path / "cut.ply", scene, [3, 8]), scene) == [3, 8]


def test_ply_without_positions(tmp_path):
    (tmp_path / "mesh.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n"
        + b"\0" * 8
    )
    with pytest.raises(InputError, match="no property z"):
        select(tmp_path / "mesh.ply", make_scene(N))


def test_reordered_scene_file_selects_the_same_gaussians(tmp_path):
    """Permuting a scene permutes its selection."""
    scene = make_scene(N)
    order = np.random.default_rng(3).permutation(N)
    ply.write(scene.select(np.array([2, 6, 7])), tmp_path / "part.ply")
    selection, permuted = (load_selection(tmp_path / "part.ply", s) for s in (scene, scene.select(order)))
    assert np.array_equal(permuted, selection[order])
