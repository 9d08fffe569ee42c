"""The table goes on where its objects stood, as pictures of it without them show."""

import numpy as np
import pytest
from benchmark_data import OWN, open_scene

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.evaluation.ground_truth import views_in
from gaussian_trimmer.evaluation.metrics import likeness
from gaussian_trimmer.evaluation.scoring import IGNORED
from gaussian_trimmer.masks.mask_files import cameras_with_masks
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.view import grown

OBJECTS = "fern", "lighthouse", "mug", "robot"


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_the_scene_without_an_object_is_what_pictures_without_it_show(name):
    folder = OWN / "tabletop"
    scene = open_scene(folder)
    cameras = read_camera_set(scene.cameras_file)
    others = tuple(folder / "masks" / other for other in OBJECTS if other != name)
    pictured = cameras_with_masks(cameras.pinhole_cameras(), folder / "removed" / name)
    _, views = views_in(pictured, folder / "masks" / name, folder / "removed" / name, others, IGNORED)
    result = trim(scene.gaussians, scene.coarse(name, "dilated"), cameras=only_training(cameras), up=scene.up)
    scores = [
        likeness(render(result.background, view.camera).rgb, view.image, grown(view.coverage > 0.5, 6) & view.counted)
        for view in views
    ]
    assert len(scores) == 4
    assert np.mean([psnr for psnr, _ in scores]) > 24
