"""The folders that are searched for benchmark data, and the scenes that come with the project."""

import numpy as np
import pytest
from benchmark_data import VARIABLE, find

from gaussian_trimmer import sample
from gaussian_trimmer.evaluation.datasets import find_scenes, open_scene

OWN = sample.SCENE.parents[3] / "benchmarks" / "data"


def test_the_folder_of_the_environment_comes_first(tmp_path, monkeypatch):
    (tmp_path / "tabletop").mkdir()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert find("tabletop") == tmp_path / "tabletop"
    if OWN.is_dir():
        assert find("parts") != tmp_path / "parts"  # what it lacks is searched elsewhere
    with pytest.raises(pytest.skip.Exception, match="no nowhere"):
        find("nowhere")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(pytest.fail.Exception, match="no folder"):
        find("tabletop")


@pytest.mark.skipif(not OWN.is_dir(), reason="a source distribution comes without benchmark scenes")
def test_the_projects_own_scenes_are_whole():
    assert [folder.name for folder in find_scenes(OWN)] == ["flat", "parts", "tabletop"]
    for folder in find_scenes(OWN):
        scene = open_scene(folder)
        assert len(scene.gaussians) == 59472
        for name in scene.objects:
            kinds = scene.coarse_kinds(name)
            assert kinds == ["centre_vote", "dilated", "eroded", "exact", "three_views", "wobbly"]
            assert all(scene.coarse(name, kind).any() for kind in kinds)
            views = list(scene.test_views(name))
            assert len(views) == 8
            assert any(view.coverage.any() for view in views)
            assert all(view.valid.all() for view in views) == (folder.name != "tabletop")
            cameras = scene.training_cameras
            assert sum(bool(np.any(scene.coverage(name, camera.name) > 0.5)) for camera in cameras) > len(cameras) / 2
