"""One object is one of several: whatever way a selection takes, object and background are the same to the byte."""

import numpy as np
import pytest
import toy
from batch_runs import write_manifest
from command_line import run

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.files import save as save_by_app
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import TrimChoices
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.selecting.marks import Sphere
from gaussian_trimmer.selecting.selection import Selection, read_selection_result
from gaussian_trimmer.trimming.config import RefineConfig, SplitConfig

pytestmark = pytest.mark.usefixtures("one_thread")
BALL, TRUTH = toy.ball_on_floor()
_RNG = np.random.default_rng(1)
_DARK = toy.gaussians(toy.CENTRE + 0.3 * _RNG.normal(size=(60, 3)), (0.05,) * 3, (0.05,) * 3)
SCENE = concatenate([BALL, _DARK])
"""A ball with what only it hides."""
ROUGH = np.append(toy.dilated(BALL, TRUTH), np.zeros(len(_DARK), np.bool_))
ERODED = np.append(TRUTH & (BALL.means[:, 0] < toy.CENTRE[0] + 0.6 * toy.RADIUS), np.zeros(len(_DARK), np.bool_))
BESIDE = (SCENE.means[:, 0] > toy.CENTRE[0] + 0.6 * toy.RADIUS) & ~ERODED
STAGES = {
    "exact": {"background": "exact"},
    "clean": {"background": "clean"},
    "filled": {"background": "filled"},
    "fitted": {"background": "filled", "refine": "fit", "refinement": RefineConfig(steps=2)},
    "split": {"split": SplitConfig("plane")},
}
UP = ["--up", 0, 0, 1]
COLUMNS = ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest")


def check_same(result, expected):
    """Both have the same object and the same background, from the same rows and with the same labels."""
    for part, other in ((result.object, expected.object), (result.background, expected.background)):
        for name in COLUMNS:
            assert getattr(part, name).tobytes() == getattr(other, name).tobytes()
    assert result.objects[0].refused == expected.objects[0].refused
    assert result.objects[0].warnings == expected.objects[0].warnings
    assert [*result.rest.warnings.values()] == [*expected.rest.warnings.values()]
    for name in ("source_index", "label", "fitted", "selected_rows"):
        assert np.array_equal(getattr(result.objects[0], name), getattr(expected.objects[0], name))
    for name in ("background_source", "background_label", "discarded"):
        assert np.array_equal(getattr(result, name), getattr(expected, name))


def as_marked(mask, excluded):
    """A selection as marks make it, which removed some Gaussians."""
    return Selection(mask, excluded=excluded)


@pytest.mark.parametrize("stages", STAGES.values(), ids=STAGES)
@pytest.mark.parametrize("selection", [ROUGH, ERODED], ids=["dilated", "eroded"])
def test_one_object_is_one_of_several(selection, stages):
    config = toy.small_config(**stages)
    expected = gt.trim(SCENE, selection, config=config)
    assert expected.objects[0].refused is None
    for objects in ({1: selection}, {"mug": selection}, [selection], np.where(selection, 5, 0)):
        check_same(gt.trim_objects(SCENE, objects, config=config), expected)


@pytest.mark.parametrize("background", ["exact", "clean", "filled"])
def test_what_marks_removed_stays_out_whatever_the_way(background):
    config = toy.small_config(background=background)
    free = gt.trim(SCENE, ERODED, config=config)
    assert free.object_mask[BESIDE].any(), "nothing would be kept out"
    expected = gt.trim(SCENE, ERODED, excluded=BESIDE, config=config)
    assert not expected.object_mask[BESIDE].any()
    check_same(gt.trim_objects(SCENE, {1: ERODED}, excluded=BESIDE, config=config), expected)
    marked = as_marked(ERODED, BESIDE)
    check_same(gt.trim(SCENE, marked, config=config), expected)
    check_same(gt.trim_objects(SCENE, {1: marked}, config=config), expected)


def test_a_selection_that_is_refused_is_returned_as_it_was_whatever_the_way():
    config = toy.small_config(background="filled")
    expected = toy.trim_by(toy.empty, SCENE, ROUGH, config=config)
    assert expected.objects[0].refused
    masks = [(view.view.camera, toy.empty(view.view)) for view in expected.objects[0].views]
    check_same(gt.trim_objects(SCENE, [ROUGH], config=config, masks=masks), expected)


def test_ten_thousand_ids_fit():
    """What is kept of each object is what it has, and not a mask of the scene."""
    from gaussian_trimmer.trimming.arguments import rough_objects
    from gaussian_trimmer.trimming.assembly import resolve_overlaps

    labels = np.arange(200_000) % 10_001
    rough = rough_objects(labels.astype(np.int32), len(labels))
    assert sum(part.rows.nbytes for part in rough) == 8 * np.count_nonzero(labels)
    rows = [part.rows for part in rough]
    small = toy.gaussians(np.zeros((len(labels), 3)), (0.1,) * 3, (0.1,) * 3)
    owner, contested = resolve_overlaps(small, rows, rows)
    assert (owner == labels).all() and not contested and owner.dtype == np.int32


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The scene, a selection with what marks removed from it, and what the command makes of it."""
    folder = tmp_path_factory.mktemp("ways")
    formats.write(BALL, folder / "scene.ply")
    ball, patch = Sphere((0, 0, 1), 1.2), Sphere((0, 0, 2), 0.5, effect="remove")
    gt.select(BALL, [ball, patch], up=toy.UP).save(folder / "rough.npy")
    np.save(folder / "labels.npy", np.where(toy.dilated(BALL, TRUTH), 3, 0))
    assert run("trim", folder / "scene.ply", folder / "rough.json", *UP, "--output", folder / "trim") == 0
    return folder


def splats(folder, name="object"):
    return [(folder / f"{file}.ply").read_bytes() for file in (name, "background")]


def test_the_command_makes_what_python_does(files):
    scene = gt.read(files / "scene.ply")
    selection = read_selection_result(files / "rough.json", scene)
    assert selection.excluded.any()
    result = gt.trim(scene, selection, up=toy.UP)
    gt.save(result, files / "python")
    assert splats(files / "python") == splats(files / "trim")


def test_labels_of_one_object_make_what_its_selection_does(files):
    common = ["trim", files / "scene.ply", *UP, "--quiet", "--output"]
    assert run(*common, files / "several", "--labels", files / "labels.npy") == 0
    assert run(*common, files / "one", files / "labels.npy", "--set", "selection.object-id=3") == 0
    assert splats(files / "several", "object_3") == splats(files / "one")


def test_the_app_cuts_out_what_the_command_does(files):
    session = Session()
    session.open(files / "scene.ply")
    session.do(edits.set_up, (0.0, 0.0, 1.0))
    session.do(edits.load, files / "rough.json")
    session.do(edits.trim_object, TrimChoices())
    save_by_app(session.now, files / "app", "ply")
    assert splats(files / "app") == splats(files / "trim")


def test_a_batch_of_one_makes_what_the_command_does(files):
    manifest = write_manifest(files, ["scene-0"], options="")
    manifest.write_text(manifest.read_text().replace("scene-0.npy", "rough.json"))
    assert run("batch", manifest, "--output", files / "batch", "--workers", 1, "--quiet") == 0
    assert splats(files / "batch" / "items" / "scene-0") == splats(files / "trim")
