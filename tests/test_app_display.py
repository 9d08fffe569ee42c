"""Tests of what the app shows: which Gaussians, in which colours, from where; and of marks on what is shown."""

import json
import zlib
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import toy

from gaussian_trimmer.app import display, edits
from gaussian_trimmer.app.display import Packing, Painter, changed_rows, changes_as_bytes, shown_rows
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import Document, Snapshot, TrimChoices
from gaussian_trimmer.app.viewpoints import (
    COLOURINGS,
    PARTS,
    WHENS,
    Frame,
    Showing,
    View,
    before_what_shows,
    points_at,
    viewpoint_of,
)
from gaussian_trimmer.cameras import look_at, point_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import write
from gaussian_trimmer.gaussians import SH_C0, concatenate
from gaussian_trimmer.selecting.marks import Box3D, Click, FromFile, Sphere
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.config import SplitConfig, TrimConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    scene, truth = toy.ball_on_floor()
    write(scene, folder / "scene.ply")
    np.save(folder / "rough.npy", toy.dilated(scene, truth))
    opened = Session()
    opened.open(folder / "scene.ply")
    opened.do(edits.set_up, (0.0, 0.0, 1.0))
    opened.do(edits.mark, FromFile(folder / "rough.npy"))
    opened.do(edits.trim_object, TrimChoices())
    opened.do(edits.add_object)
    opened.do(edits.mark, Sphere((2.5, 2.5, 0.0), 0.5))
    return opened


@pytest.fixture
def first(session):
    """The session with the first object, which was cut out, as the active one."""
    session.do(edits.activate, 1, joined=True)
    yield session
    session.do(edits.activate, 2, joined=True)


def seen(now, showing):
    """Which Gaussians of the scene and of the layers the page draws, and in which tint, as its shader decides it."""
    painter = Painter(now.document.scene)
    states = painter.states(now)
    layers = painter.layers(now, states)
    states = np.concatenate([states, *(layer.states for layer in layers)])
    before, after, bits = states.T.astype(int)
    cut_out, active = showing.when == "Cut-out", now.active + 1
    owner, extra = (after if cut_out else before), bits & display.EXTRA > 0
    together = now.object.together
    taken = [part is now.object or (part.together and together) for part in now.objects]
    hidden = [
        p.hidden or (gone and showing.part == "Scene without it") for p, gone in zip(now.objects, taken, strict=True)
    ]
    visible = ~np.array([False, *hidden])[owner]
    gone, replaced = (cut_out & (bits & bit > 0) for bit in (display.GONE, display.REPLACED))
    if showing.part == "Object" and not showing.ghost:
        removed = (bits & display.ACTIVE_REMOVED > 0) & (showing.colours == "Changes")
        own, piece = ((owner == active) | removed) & ~replaced, owner == active
    else:
        own, piece = visible & ~gone & ~replaced, visible
    pieces, fills = (bits & display.PIECE > 0) & piece, (bits & display.FILL > 0) & (showing.part != "Object")
    shown = np.where(extra, cut_out & (pieces | fills), own)
    gaussians = concatenate([now.document.scene, *(layer.gaussians for layer in layers)])
    return shown, gaussians, owner, bits


def test_before_the_objects_have_their_numbers_and_nothing_else(session):
    now = session.now
    shown, _, owner, _ = seen(now, Showing())
    n = len(session.document.scene)
    assert shown[:n].all() and not shown[n:].any()
    for place, part in enumerate(now.objects):
        assert np.array_equal(owner[:n] == place + 1, part.selected.mask)


@pytest.mark.parametrize("hidden", [False, True])
def test_what_the_page_draws_is_what_marks_go_by_and_what_files_hold(session, hidden):
    session.do(edits.describe, 1, "hidden", hidden)
    now, scene, n = session.now, session.document.scene, len(session.document.scene)
    result, second = now.objects[0].fresh, np.flatnonzero(now.object.selected.mask)
    for part, when, colours in product(PARTS, WHENS, COLOURINGS):
        for ghost in (False, True)[: 1 + (part == "Object")]:
            showing = Showing(part, when, colours, ghost)
            shown, _, _, bits = seen(now, showing)
            replaced = (bits[:n] & display.REPLACED > 0) & (when == "Cut-out")
            assert np.array_equal(shown[:n], shown_rows(now, showing) & ~replaced), showing
    for when, rest in (("Selection", now.objects[0].selected.mask), ("Cut-out", result.object_mask)):
        assert seen(now, Showing("Object", when))[0].sum() == now.object.n_selected  # the second one is not trimmed
        gone = len(result.discarded) - result.count(RowLabel.FILLED) if when == "Cut-out" else 0
        more = len(result.object) - result.object_mask.sum() if when == "Cut-out" else 0  # the fit has cut some in two
        first = rest.sum() + more if hidden else 0
        assert seen(now, Showing("Everything", when))[0].sum() == len(scene) - gone + more - first  # filled, also then
        assert seen(now, Showing("Scene without it", when))[0].sum() == len(scene) - gone + more - first - len(second)
    session.undo()


def large_ball():
    """A ball of Gaussians so large that they straddle its outline, and which they are."""
    scene, truth = toy.ball_on_floor()
    return scene.replace(log_scales=scene.log_scales + np.log(4) * truth[:, None].astype(np.float32)), truth


def test_split_parts_and_filled_gaussians_are_shown():
    scene, truth = large_ball()
    result = trim(scene, truth, config=TrimConfig(split=SplitConfig("plane")), up="z")
    n_split = result.count(RowLabel.SPLIT_OUTSIDE)
    assert n_split > 0
    document = Document(Path("a.ply"), None, scene, None)
    first = Snapshot.first(document, document.find_up((0.0, 0.0, 1.0)))
    selected = Selection(truth, np.zeros_like(truth))
    now = first.with_object(replace(first.object, selected=selected, result=result), "cut out")
    drawn = {}
    for part, expected in (("Object", result.object), ("Scene without it", result.background)):
        shown, gaussians, _, _ = seen(now, Showing(part, "Cut-out"))
        drawn[part] = shown.sum()
        assert np.allclose(np.sort(gaussians.means[shown], axis=0), np.sort(expected.means, axis=0))
    assert seen(now, Showing("Everything", "Cut-out"))[0].sum() == sum(drawn.values())


def test_changes_are_told(first):
    now = first.now
    result, n = now.object.fresh, len(first.document.scene)
    added, removed, cut, _ = changed_rows(now.object)
    assert np.array_equal(removed, result.selection & ~result.object_mask) and removed.any()
    shown, _, _, bits = seen(now, Showing("Object", "Cut-out", "Changes"))
    plain = seen(now, Showing("Object", "Cut-out", "Own"))[0]
    assert shown.sum() == plain.sum() + (removed & ~cut).sum()  # what was removed is seen, too
    changes = zip(*map(changed_rows, now.objects), strict=True)
    for bit, rows in zip((display.ADDED, display.REMOVED, display.CUT, display.MADE_UP), changes, strict=True):
        assert np.array_equal(bits[:n] & bit > 0, np.any(rows, axis=0))
    without = seen(now, Showing("Scene without it", "Cut-out", "Changes"))[0]
    assert (without & (bits & display.EXTRA > 0) & (bits & display.MADE_UP > 0)).sum() == (
        result.count(RowLabel.FILLED) + result.count(RowLabel.RELIT)
    )
    assert not added.any() or (added & result.object_mask).any()


def unpacked(data, packing):
    """Means, standard deviations, colours, opacities and rotations that packed Gaussians stand for."""
    words = np.frombuffer(data, np.uint32).reshape(-1, 8)

    def parts(column, bits, count):
        return (words[:, column, None] >> (bits * np.arange(count)).astype(np.uint32)) & ((1 << bits) - 1)

    means = packing.frame.to_scene(words[:, :3].copy().view(np.float32))
    scales = np.exp(parts(3, 10, 3) / 1023 * 20 - 14) / packing.frame.scale
    low, high = packing.tones
    rgba = parts(4, 8, 4) / 255
    small = (parts(5, 10, 3) / 511 - 1) / np.sqrt(2)
    rest = np.sqrt(1 - (small**2).sum(axis=1))
    turns = np.array([np.insert(row, k, w) for row, k, w in zip(small, words[:, 5] >> 30, rest, strict=True)])
    ninth = parts(6, 4, 8)[:, 7:] | (parts(7, 4, 8)[:, 7:] << 4)
    harmonics = np.concatenate([parts(6, 7, 4), parts(7, 7, 4), ninth], axis=1)
    return means, scales, rgba[:, :3] * (high - low) + low, rgba[:, 3], turns, (harmonics / 63 - 1) * packing.harmonics


def test_a_scene_is_packed_once_the_coarse_one_first_and_nothing_is_lost():
    scene, _ = toy.ball_on_floor()
    random = np.random.default_rng(0)
    rest = random.normal(0, 0.1, (len(scene), 3, 8)).astype(np.float32)
    scene = scene.replace(sh_rest=rest, quaternions=random.normal(0, 1, (len(scene), 4)).astype(np.float32))
    packing = Packing.of(scene)
    portions = list(packing.portions(scene, len(scene)))
    assert len(portions) == 16 and sum(map(len, portions)) == 32 * len(scene)
    assert sorted(packing.order) == list(range(len(scene)))
    coarse = scene.select(packing.order[::16])
    means, scales, colours, opacities, turns, harmonics = unpacked(portions[0], packing)
    assert np.allclose(means, coarse.means, atol=1e-5) and np.allclose(scales, coarse.scales, rtol=0.02)
    assert np.allclose(colours, 0.5 + SH_C0 * coarse.sh_dc, atol=0.004)
    assert np.allclose(opacities, coarse.opacities, atol=0.003)
    same = np.abs((turns * coarse.quaternions).sum(axis=1)) / np.linalg.norm(coarse.quaternions, axis=1)
    assert same.min() > 0.99999
    largest = np.clip(coarse.sh_rest[:, :, :3].reshape(-1, 9), -packing.harmonics, packing.harmonics)
    assert np.allclose(harmonics, largest, atol=packing.harmonics / 100)
    cover = scene.opacities * np.sort(scene.scales, axis=1)[:, 1:].prod(axis=1)
    blocks = cover[packing.order][: len(scene) // 16 * 16].reshape(
        -1, 16
    )  # of each sixteen, what covers most comes first
    assert (np.diff(np.minimum(blocks, np.quantile(cover, 0.99)), axis=1) <= 1e-6 * cover.max()).all()
    assert packing.covered[0] > 1 / 16 and packing.covered[-1] == 1 and (np.diff(packing.covered) >= 0).all()
    spread = np.linalg.norm(np.diff(scene.means[packing.order], axis=0), axis=1)
    assert np.median(spread) < 0.2 * np.median(np.linalg.norm(np.diff(random.permutation(scene.means), axis=0), axis=1))
    assert packing.shown(len(scene) // 4) == pytest.approx(len(scene) / 4, rel=0.02)
    assert sum(map(len, packing.portions(scene, len(scene) // 4))) == 32 * packing.shown(len(scene) // 4)
    one = scene.select(np.arange(1))
    assert Packing.of(one).shown(1000) == 1 and list(Packing.of(one).portions(one, 1000))


def test_only_what_changes_is_told(session):
    painter, now = Painter(session.document.scene), session.now
    order, before = painter.packing.order, painter.states(now)
    session.do(edits.mark, Sphere((-2.5, 2.5, 0.0), 0.5))
    after = painter.states(session.now)
    session.undo()

    def told(*arguments):
        head, _, data = changes_as_bytes(*arguments, order).partition(b"\n")
        head, parts = json.loads(head), []
        for length in head["bytes"]:
            parts.append(np.frombuffer(zlib.decompress(data[:length]), np.uint8))
            data = data[length:]
        assert not data
        changed = np.unpackbits(parts[0], bitorder="little", count=len(order)).astype(bool)
        return head, order[changed], parts[1].reshape(3, -1).T, parts[2].reshape(3, -1).T

    head, rows, values, extras = told(before, after, [])
    assert set(rows) == set(np.flatnonzero((before != after).any(axis=1))) and not head["whole"] and not len(extras)
    assert np.array_equal(values, after[rows])
    layers = painter.layers(now, before)
    head, rows, values, extras = told(None, before, layers)
    assert head["whole"] and set(rows) == set(np.flatnonzero(before.any(axis=1)))
    assert np.array_equal(extras, layers[0].states) and head["layers"] == [[layers[0].number, len(extras)]]
    assert painter.layers(now, before)[0].number == layers[0].number  # the same result is drawn once
    assert len(changes_as_bytes(before, before, [], order)) < 200


def test_after_further_marks_the_cut_out_is_seen_with_them_and_changes_are_theirs(first):
    before, changes = first.now.object.mask, Showing("Object", "Cut-out", "Changes")
    first.do(edits.mark, toy.TOP)
    stale = first.now.object
    inside = np.linalg.norm(first.document.scene.means - np.array(toy.TOP.centre), axis=1) <= toy.TOP.radius
    assert stale.fresh is None and np.array_equal(stale.mask, before & ~inside)
    assert np.array_equal(changed_rows(stale)[1], before & inside)
    assert shown_rows(first.now, changes)[before & inside].all()  # until it is cut out again
    first.do(edits.trim_object, TrimChoices(), joined=True, again=True)
    fresh = first.now.object
    assert np.array_equal(changed_rows(fresh)[1], before & ~fresh.mask)
    assert not shown_rows(first.now, changes)[before & inside].all()
    first.undo()


def test_the_frame_makes_any_scene_a_few_units_large():
    scene, _ = toy.ball_on_floor()
    for scale, shift in ((1e-4, 0.0), (1.0, 1e5), (1e4, 3.0)):
        frame = Frame.around((scene.means * np.float32(scale) + np.float32(shift)).astype(np.float32))
        points = scene.means.astype(np.float64) * scale + shift
        assert np.median(np.linalg.norm(frame.to_viewer(points), axis=1)) == pytest.approx(5, rel=0.05)
        assert np.allclose(frame.to_scene(frame.to_viewer(points)), points)
    assert Frame.around(np.ones((3, 3), np.float32)).scale == 1


def browser(frame, eye=(0.0, -8.0, 4.0), width=200, height=100):
    eye, target = (point_of(frame.to_viewer(np.array(point))) for point in (eye, toy.CENTRE))
    return viewpoint_of(View(eye, target, point_of(toy.UP), 0.8, width, height), frame)


def test_a_browsers_camera_is_the_same_camera_in_the_scene():
    scene, _ = toy.ball_on_floor()
    frame = Frame.around(scene.means)
    camera = browser(frame).camera
    assert np.allclose(camera.centre, (0, -8, 4))
    assert np.allclose(camera.world_to_camera, look_at(np.array([0.0, -8, 4]), toy.CENTRE, toy.UP), atol=1e-6)
    assert np.allclose(camera.project(toy.CENTRE[None])[0], (100, 50), atol=1e-4)
    assert 2 * np.arctan(50 / camera.K[1, 1]) == pytest.approx(0.8)


def test_points_lie_on_the_surface_and_are_nan_in_the_void():
    scene, _ = toy.ball_on_floor(n_floaters=0)
    frame = Frame.around(scene.means)
    view = browser(frame)
    on_ball, void = points_at(scene, view, [(0.5, 0.5), (0.5, 0.0)])
    assert np.linalg.norm(np.array(on_ball) - toy.CENTRE) == pytest.approx(toy.RADIUS, abs=0.12)
    assert on_ball[1] < 0
    assert np.isnan(void).all()


def test_with_the_object_alone_a_click_means_the_object_and_not_what_is_hidden_before_it(session):
    session.do(edits.add_object)
    session.do(edits.remove_object, 1)  # which has the ball
    session.do(edits.mark, Box3D((-2.0, -2.0, 0.02), (2.0, 2.0, 3.0)))  # the ball without the floor
    now, scene = session.now, session.document.scene
    shown = scene.select(np.flatnonzero(shown_rows(now, Showing("Object"))))
    view = browser(Frame(np.zeros(3), 1.0), eye=(0.5, 0.0, -6.0), width=160, height=160)
    before = now.object.n_selected
    with pytest.raises(InputError, match="not selected"):
        session.do(edits.mark, Click(80, 88, view, "remove"))  # meets the floor
    past = before_what_shows(shown, view, [(0.5, 0.55)])
    session.do(edits.mark, Click(80, 88, past, "remove"))
    assert session.now.object.n_selected < before
    with pytest.raises(InputError, match="Nothing that is shown"):
        before_what_shows(shown, view, [(0.0, 0.0)])
    for _ in range(4):
        session.undo()
