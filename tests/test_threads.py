"""The number of threads changes no bit of any result, and calls from several Python threads do not disturb others."""

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import cv2
import made_room as room
import numba
import numpy as np
import pytest
from toy import ball_on_floor, dilated, small_config, tight, trim_by, two_balls

from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.rendering import blend_values, blend_weights, render, top_contributors
from gaussian_trimmer.rendering.gradients import gradients
from gaussian_trimmer.rendering.tile_renderer import draw, draw_projected
from gaussian_trimmer.selecting.marks import Click
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.trimming.config import SplitConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim_objects
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

N_CALLS = 12


def digest(arrays):
    """One number for the exact contents of arrays."""
    total = hashlib.sha256()
    for array in arrays:
        total.update(f"{array.shape} {array.dtype}".encode() + np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


@cache
def ball_and_view():
    scene, truth = ball_on_floor()
    cameras, _ = plan_cameras(scene.select(truth), np.array([0.0, 0.0, 1.0]), PlanConfig(size=100))
    return scene, truth, cameras[0]


def rendered():
    """What the kernels make of the toy scene."""
    scene, truth, camera = ball_and_view()
    shown = render(scene, camera)
    labels = (shown.alpha > 0.5).astype(np.uint8)
    pixels = np.argwhere(labels)[::7, ::-1]
    return digest([
        shown.rgb, shown.alpha, shown.depth, blend_values(scene, camera, truth[:, None].astype(np.float32)),
        blend_weights(scene, camera, labels, 2), *top_contributors(scene, camera, pixels, 5),
    ])  # fmt: skip


def views_at_once():
    """What the kernels make of several views of it at once, of different sizes, and derivatives by half of it."""
    scene, truth, _ = ball_and_view()
    cameras, _ = plan_cameras(scene.select(truth), np.array([0.0, 0.0, 1.0]), PlanConfig(size=100))
    cameras = [camera.resized(1 - 0.1 * i) for i, camera in enumerate(cameras)]
    masks = [np.indices((camera.height, camera.width)).sum(axis=0, keepdims=True) % 3.0 for camera in cameras]
    drawing = draw(scene, cameras, values=scene.means, images=[mask.astype(np.float32) for mask in masks])
    part = draw_projected(scene, drawing.projection.of(truth).around(np.arange(len(scene)) % 5 == 0))
    slopes = np.cos(np.arange(4 * drawing.tiled[0].size, dtype=np.float32)).reshape(4, *drawing.tiled[0].shape)
    found = gradients(drawing, slopes, np.arange(len(scene)) % 2 == 0)
    return digest([drawing.tiled, drawing.weights, part.tiled, found])


def neighbours():
    """The nearest centres of every centre of the toy scene."""
    means = ball_and_view()[0].means
    return digest(nearest(means, means, 32))


def trimmed():
    """A whole trim, splits included."""
    scene, truth, _ = ball_and_view()
    config = small_config(split=SplitConfig("plane"))
    result = trim_by(tight, scene, dilated(scene, truth), config=config)
    assert result.objects[0].refused is None
    assert result.count(RowLabel.SPLIT_INSIDE) > 5
    parts = [
        getattr(part, name)
        for part in (result.object, result.rest.appended)
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc")
    ]
    return digest(
        [
            result.objects[0].source_index,
            result.objects[0].label,
            result.background_source,
            *parts,
            *(view.mask for view in result.objects[0].views),
        ]
    )


def together():
    """Two objects trimmed together, with outlines fitted and the floor continued."""
    scene, *masks = two_balls()
    config = small_config(refine="fit", background="filled", plan=PlanConfig(size=96))
    result = trim_objects(scene, masks, config=config)
    rest = result.background
    parts = [part.gaussians for part in result.objects]
    return digest([rest.means, rest.sh_dc, *(part.means for part in parts), *(part.opacity_logits for part in parts)])


def found():
    """What is found in a room, and what clicks on the toy scene select, one by the tree and one by a cut."""
    objects = find_objects(room.scene_of(room.floor(), room.ball((0.3, 1.2), 0.5, room.BLUE, 2))[0], up=(0, 0, 1))
    scene, _, camera = ball_and_view()
    clicks = Click(50, 50, Viewpoint(camera)), Click(50, 60, Viewpoint(camera), "remove")
    selected = [select(scene, clicks[:count], up=(0, 0, 1)).mask for count in (1, 2)]
    return digest([objects.labels, *(np.array(one.confidence) for one in objects), *selected])


def at_the_same_time(function):
    """What many calls return, four of them running at any time."""
    with ThreadPoolExecutor(4) as pool:
        return {future.result() for future in [pool.submit(function) for _ in range(N_CALLS)]}


def in_a_process(expression, **environment):
    """The words that an expression of this module prints in a process with other environment variables."""
    path = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "-c", f"from test_threads import *\nprint({expression})"],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture
def threads():
    """Sets the number of threads, and sets it back in the end."""
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


@pytest.mark.parametrize("work", [rendered, views_at_once, neighbours, trimmed, together, found])
def test_one_and_two_threads_agree(work, threads):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("Numba was started with one thread.")
    results = set()
    for n in (1, 2):
        threads(n)
        results.add(work())
    assert len(results) == 1


@pytest.mark.slow
def test_opencv_with_one_thread_agrees():
    before = cv2.getNumThreads()
    expected = trimmed()
    cv2.setNumThreads(1)
    try:
        assert {trimmed() for _ in range(6)} == {expected}
    finally:
        cv2.setNumThreads(before)


@pytest.mark.slow
def test_eight_threads_agree_however_few_cores_there_are():
    expected = ["8", rendered(), neighbours(), trimmed()]
    expression = "numba.get_num_threads(), rendered(), neighbours(), trimmed()"
    assert in_a_process(expression, NUMBA_NUM_THREADS="8") == expected


@pytest.mark.slow
@pytest.mark.parametrize("work", [rendered, neighbours, trimmed, together])
def test_simultaneous_calls_agree(work):
    assert at_the_same_time(work) == {work()}
