"""Marks understood by a model: whole objects as the built-in way has them, parts as the model sees them."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.masks.sam_onnx import Candidates
from gaussian_trimmer.selecting import model_masks
from gaussian_trimmer.selecting.clicks import NothingFoundError, Pick, select_by_box, select_by_click
from gaussian_trimmer.selecting.model_masks import select_by_model
from gaussian_trimmer.surface.viewed_scene import ViewedScene
from gaussian_trimmer.views.view import bounding_box


def viewed(scene, camera):
    return ViewedScene(scene, camera, toy.UP)


class Oracle:
    """A model that sees a known part, whatever the view, and proposes nothing and everything beside it."""

    def __init__(self, scene, part, cameras, scores=(0.2, 0.9, 0.1)):
        self.scene, self.part, self.cameras, self.scores, self.prompts = scene, part, cameras, scores, []

    def propose(self, rgb, prompt):
        self.prompts.append(prompt)
        if prompt.logits is not None:  # another view: the expected silhouette stands in for what a model sees
            right = prompt.logits > 0
        else:
            right = viewed(self.scene, self.cameras).coverage(self.part) > 0.5
        masks = np.stack([np.zeros_like(right), right, np.ones_like(right)])
        return Candidates(np.where(masks, 5.0, -5.0).astype(np.float32), np.array(self.scores, np.float32))


@pytest.fixture(scope="module")
def ball():
    return toy.ball_on_floor(n_ball=1500)


def box_of(scene, part, camera):
    return bounding_box(viewed(scene, camera).coverage(part) > 0.5, 2)


def test_what_the_built_in_way_finds_too_is_left_to_it(ball):
    scene, truth = ball
    camera = toy.camera_at((5, 0, 3))
    box, oracle = box_of(scene, truth, camera), Oracle(scene, truth, camera)
    pick = select_by_model(viewed(scene, camera), box, oracle)
    np.testing.assert_array_equal(pick.selection, select_by_box(viewed(scene, camera), box).selection)
    assert len(oracle.prompts) == 1
    assert oracle.prompts[0].box == box


def test_a_click_on_what_stands_on_something_means_that_without_asking(ball):
    scene, truth = ball
    camera = toy.camera_at((5, 0, 3))
    x, y = camera.project(np.atleast_2d(np.asarray(toy.CENTRE, float)))[0][0]
    mark, oracle = (int(x), int(y)), Oracle(scene, truth, camera)
    pick = select_by_model(viewed(scene, camera), mark, oracle)
    np.testing.assert_array_equal(pick.selection, select_by_click(viewed(scene, camera), *mark).selection)
    assert pick.kind == "piece"
    assert not oracle.prompts


def test_a_part_is_carried_around_the_object(ball, monkeypatch):
    """The built-in way takes the whole ball for what is meant; the model sees its upper half, and that is selected."""
    scene, truth = ball
    part = truth & (scene.means[:, 2] > np.median(scene.means[truth, 2]))
    camera = toy.camera_at((5, 0, 3))
    oracle = Oracle(scene, part, camera)
    monkeypatch.setattr(model_masks, "select_by_box", lambda *_: Pick(truth, "piece"))
    pick = select_by_model(viewed(scene, camera), box_of(scene, part, camera), oracle)
    assert pick.kind == "part"
    assert len(oracle.prompts) == 5
    assert toy.jaccard(pick.selection, part) > toy.jaccard(truth, part) + 0.1
    seen = viewed(scene, camera).coverage(pick.selection) > 0.5, viewed(scene, camera).coverage(part) > 0.5
    assert np.count_nonzero(seen[0] & seen[1]) > 0.9 * np.count_nonzero(seen[0] | seen[1])
    far = part & (scene.means[:, 0] < toy.CENTRE[0])
    assert np.count_nonzero(pick.selection & far) > 0.4 * np.count_nonzero(far)


def test_where_nothing_stands_the_model_says_what_a_click_means(ball, monkeypatch):
    """It is asked with the pixel's centre, and its mask with the best score is taken."""
    scene, truth = ball
    camera = toy.camera_at((5, 0, 3))

    def refuse(*_):
        raise NothingFoundError("Nothing stands there.")

    monkeypatch.setattr(model_masks, "select_by_click", refuse)
    oracle = Oracle(scene, truth, camera)
    pick = select_by_model(viewed(scene, camera), (100, 100), oracle)
    assert pick.kind == "part"
    assert toy.jaccard(pick.selection, truth) > 0.6
    assert oracle.prompts[0].inside.all()
    np.testing.assert_allclose(oracle.prompts[0].points, [[100.5, 100.5]])
    with pytest.raises(NothingFoundError, match="Neither the surface nor the model"):
        select_by_model(viewed(scene, camera), (100, 100), Oracle(scene, np.zeros_like(truth), camera))


def test_marks_outside_the_picture_are_refused_before_the_model_is_asked(ball):
    scene, truth = ball
    camera = toy.camera_at((5, 0, 3))
    oracle = Oracle(scene, truth, camera)
    with pytest.raises(InputError, match="outside"):
        select_by_model(viewed(scene, camera), (300, 5), oracle)
    assert not oracle.prompts
