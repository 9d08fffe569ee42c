"""The library in one import: what it loads and when, what `trim` takes, and what results can do."""

import html
import inspect
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import toy
from command_line import run

import gaussian_trimmer as gt
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.output.saving import result_files, save
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.arguments import rows_of_selection
from gaussian_trimmer.trimming.config import SplitConfig
from gaussian_trimmer.trimming.up_vector import find_up

SCENE, TRUTH = toy.ball_on_floor()
ROUGH = toy.dilated(SCENE, TRUTH)
CONFIG = toy.small_config(split=SplitConfig("plane"))
HEAVY = {"numba", "cv2", "numpy", "rich", "torch"}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def result():
    return toy.trim_by(toy.tight, SCENE, ROUGH, config=CONFIG)


def loaded_by(code):
    """Names of the packages and modules that a fresh interpreter has loaded after some code."""
    code = f"import sys; sys.argv = ['gaussian-trimmer']; {code}; print(); print(*sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(Path(gt.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return set(done.stdout.splitlines()[-1].split())


# The import


def test_importing_the_package_loads_nothing_heavy():
    modules = loaded_by("import gaussian_trimmer")
    assert not modules & HEAVY
    assert {name for name in modules if name.startswith("gaussian_trimmer")} == {
        "gaussian_trimmer",
        "gaussian_trimmer._version",
    }


def test_listing_names_and_catching_errors_loads_nothing_heavy():
    assert not loaded_by("import gaussian_trimmer as gt; dir(gt); gt.InputError") & HEAVY


def test_reading_a_scene_compiles_nothing():
    modules = loaded_by("import gaussian_trimmer as gt; gt.read, gt.write, gt.read_selection, gt.Gaussians")
    assert "numpy" in modules and not modules & {"numba", "cv2", "gaussian_trimmer.trimming.trim"}


def test_help_of_reading_commands_does_not_load_the_trimmer():
    code = "from gaussian_trimmer.cli import main\ntry: main(['convert', '--help'])\nexcept SystemExit: pass\nprint()"
    modules = loaded_by(f"exec({code!r})")
    assert not modules & {"numba", "torch", "gaussian_trimmer.trimming.trim"}


def test_trimming_does_not_load_what_cuts_at_masks_before_it_is_asked_for():
    modules = loaded_by("import gaussian_trimmer as gt; gt.trim")
    late = {"gaussian_trimmer.trimming.paper", "gaussian_trimmer.trimming.straddlers"}
    assert "gaussian_trimmer.trimming.decision" in modules and not modules & late


def test_all_names_exist_and_are_listed():
    assert set(gt.__all__) <= set(dir(gt))
    for name in gt.__all__:
        assert getattr(gt, name) is not None
    assert {"read", "read_cameras", "trim", "trim_objects", "save", "describe"} <= set(gt.__all__)
    assert not {"Any", "TYPE_CHECKING", "import_module"} & set(dir(gt))


# What trim takes


def test_everything_after_the_selection_is_given_by_name():
    parameters = list(inspect.signature(gt.trim).parameters.values())
    assert [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD] == ["scene", "selection"]


def test_views_and_up_need_no_nested_settings(result):
    other = toy.trim_by(toy.tight, SCENE, ROUGH, config=toy.small_config(up=None), up="z", views=3)
    assert len(other.objects[0].views) == 3
    assert (other.config.plan.views, other.config.plan.size, other.objects[0].up.source) == (3, 160, "given")
    np.testing.assert_array_equal(other.objects[0].up.direction, toy.UP)


@pytest.mark.parametrize(
    "same",
    [
        ROUGH.astype(np.uint8),
        255 * ROUGH.astype(np.uint8),
        ROUGH.astype(np.int64),
        np.flatnonzero(ROUGH),
        np.flatnonzero(ROUGH)[::-1].astype(np.uint16),
        np.flatnonzero(ROUGH).tolist(),
        ROUGH.tolist(),
    ],
)
def test_masks_of_whole_numbers_and_row_numbers_are_selections(same):
    np.testing.assert_array_equal(rows_of_selection(same, len(SCENE)), np.flatnonzero(ROUGH))


@pytest.mark.parametrize(
    ("selection", "n", "said"),
    [
        (np.array([0, 1]), 2, "both a mask and row numbers"),
        (np.array([0]), 1, "both a mask and row numbers"),
        (np.array([3, 3]), 5, r"neither .*row 3 is there 2 times.*'labels == 3'"),
        (np.array([0, 1, 2, 2, 0]), 5, "neither a mask nor row numbers"),
        (np.array([0, 1, 255, 0, 0]), 5, "neither"),
        (np.array([0, 1, 1]), 5, "neither"),
        (np.array([-1, 2]), 5, "from -1 to 2"),
        (np.array([0.2, 0.9]), 2, "'scores > 0.5'"),
        (np.zeros((5, 1), np.int64), 5, r"shape \(5, 1\)"),
        (np.zeros(4, np.bool_), 5, r"shape \(4,\) and type bool"),
        ([], 5, "selection is empty"),
        (np.zeros(5, np.int64), 5, "selection is empty"),
        ([[1], [2, 3]], 5, "NumPy cannot read"),
        ("rough.npy", 5, r"selection is a str; .*read_selection\(path, scene\)"),
    ],
)
def test_selections_that_can_be_misunderstood_are_refused(selection, n, said):
    with pytest.raises(gt.InputError, match=said):
        rows_of_selection(selection, n)


def test_ambiguity_ends_where_only_one_reading_is_possible():
    assert rows_of_selection(np.array([1, 1]), 2).tolist() == [0, 1]
    assert rows_of_selection(np.array([0, 255]), 2).tolist() == [1]
    assert rows_of_selection(np.array([1]), 1).tolist() == [0]
    assert rows_of_selection(np.arange(5)[::-1], 5).tolist() == [0, 1, 2, 3, 4]
    assert rows_of_selection(np.array([0, 1]), 3).tolist() == [0, 1]


def test_a_selection_that_changes_later_does_not_change_the_result():
    selection = ROUGH.copy()
    result = toy.trim_by(toy.empty, SCENE, selection, config=CONFIG, views=1)
    selection[:] = False
    np.testing.assert_array_equal(result.selection, ROUGH)


CAMERA = toy.trim_by(toy.empty, SCENE, ROUGH, config=CONFIG, views=1).objects[0].views[0].view.camera


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"views": [CAMERA]}, r"plan\.views is"),
        ({"views": True}, r"plan\.views is True"),
        ({"views": 0}, r"plan\.views is 0"),
        ({"views": 3, "view_cameras": [CAMERA]}, "beside 1 view_cameras"),
        ({"view_cameras": []}, "view_cameras"),
        ({"view_cameras": CAMERA}, "view_cameras"),
        ({"view_cameras": CameraSet((CAMERA,), None, (True,), False)}, "view_cameras"),
        ({"masks": [np.ones((4, 4), np.bool_)]}, "pairs of a camera and its mask"),
        ({"masks": []}, "give at least one"),
        ({"masks": [(CAMERA, np.ones((4, 4), np.bool_))]}, r"Mask 0 has the shape \(4, 4\) .* 160 rows of 160"),
        ({"masks": [(CAMERA, np.ones((160, 160), np.uint8))]}, r"type uint8; booleans"),
        ({"masks": [(CAMERA, np.ones((160, 160)))], "view_cameras": [CAMERA, CAMERA]}, "leave view_cameras out"),
        ({"cameras": [np.eye(4)]}, "cameras are a list"),
        ({"up": "--z"}, "up vector is '--z'"),
        ({"up": (0, 0, 0)}, "up vector"),
        ({"up": 3}, "up vector"),
        ({"up": (0, 0, 1, "sure")}, "fourth number of an up vector is sure"),
        ({"config": {"up": "z"}}, "config is a dict"),
        ({"scene": "scene.ply"}, "scene is a str"),
    ],
)
def test_arguments_of_another_kind_are_refused(wrong, said):
    with pytest.raises(gt.InputError, match=said):
        gt.trim(**{"scene": SCENE, "selection": ROUGH, "config": CONFIG, **wrong})


def test_a_path_is_refused_wherever_a_scene_is_taken(tmp_path):
    calls = (
        lambda path: gt.find_objects(path),
        lambda path: gt.select(path, []),
        lambda path: gt.read_selection("rough.npy", path),
        lambda path: gt.write(path, tmp_path / "copy.ply"),
    )
    for call in calls:
        with pytest.raises(gt.InputError, match=r"scene is a str.*gaussian_trimmer\.read"):
            call("scene.ply")
    with pytest.raises(gt.InputError, match=r"Gaussians.*gaussian_trimmer\.trim"):
        gt.save(SCENE, tmp_path / "saved")


def test_an_axis_is_an_up_vector_everywhere():
    assert find_up(SCENE, given="-y").direction.tolist() == [0, -1, 0]
    with pytest.raises(gt.InputError, match="'zz'"):
        gt.find_objects(SCENE, up="zz")


def test_results_are_shown_in_a_line(result):
    texts = [
        repr(part)
        for part in (
            SCENE,
            result,
            result.objects[0],
            CameraSet((toy.camera_at((5, 0, 3)),), None, (True,), False),
            Selection(ROUGH, interpretations=("a sphere",)),
            result.objects[0].views[0],
        )
    ]
    assert all("\n" not in text and len(text) < 100 for text in texts)
    assert f"{len(SCENE):,}" in texts[0] and f"{len(result.object):,}" in texts[1] and "1 cameras" in texts[3]
    assert "a sphere" in texts[4] and "x" in texts[5]


# Gaussians of other number types and from other programs


def doubled():
    names = ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest")
    return gt.Gaussians(*(getattr(SCENE, name).astype(np.float64) for name in names))


def test_float64_is_converted_and_nothing_compiled_for_it(result):
    from gaussian_trimmer.rendering import numba_kernels, projection_kernels

    def compiled():
        modules = [*vars(numba_kernels).values(), *vars(projection_kernels).values()]
        kernels = [value for value in modules if hasattr(value, "signatures")]
        assert kernels
        return [list(kernel.signatures) for kernel in kernels]

    before, scene = compiled(), doubled()
    assert {getattr(scene, name).dtype for name in ("means", "quaternions", "sh_rest")} == {np.dtype(np.float32)}
    other = toy.trim_by(toy.tight, scene, ROUGH, config=CONFIG)
    assert compiled() == before
    np.testing.assert_array_equal(other.objects[0].source_index, result.objects[0].source_index)
    np.testing.assert_array_equal(other.object.means, result.object.means)


def test_float32_arrays_are_not_copied():
    means = SCENE.means
    assert SCENE.replace(means=means).means is means


def coloured(degree, n=6):
    rng = np.random.default_rng(degree)
    return gt.Gaussians(
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 4)), rng.normal(size=n),
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3, (degree + 1) ** 2 - 1)),
    )  # fmt: skip


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_arrays_there_and_back_are_the_same_to_the_last_bit(degree):
    scene = coloured(degree)
    arrays = scene.to_arrays()
    assert arrays["sh"].shape == (6, (degree + 1) ** 2, 3)
    again = gt.Gaussians.from_arrays(**arrays)
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(again, name), getattr(scene, name))
        assert getattr(again, name).flags.c_contiguous
        assert not np.shares_memory(getattr(again, name), getattr(scene, name)) or not getattr(again, name).size


def test_coefficients_come_before_channels_in_arrays():
    sh = np.arange(12.0).reshape(1, 4, 3)
    scene = gt.Gaussians.from_arrays([[0, 0, 0]], [[1, 0, 0, 0]], sh, log_scales=[[0, 0, 0]], opacity_logits=[0])
    assert scene.sh_dc.tolist() == [[0, 1, 2]]
    assert scene.sh_rest[0, 0].tolist() == [3, 6, 9]  # red


def test_linear_values_are_given_by_name():
    arrays = {**coloured(1).to_arrays(activated=True)}
    assert {"scales", "opacities"} < set(arrays) and "log_scales" not in arrays
    again = gt.Gaussians.from_arrays(**arrays)
    np.testing.assert_allclose(again.log_scales, coloured(1).log_scales, atol=1e-6)
    np.testing.assert_allclose(again.opacity_logits, coloured(1).opacity_logits, atol=1e-5)
    arrays["opacities"] = arrays["opacities"][:, None]  # as Inria's code holds them
    assert gt.Gaussians.from_arrays(**arrays).opacity_logits.shape == (6,)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"log_scales": None}, "Give either scales or log_scales"),
        ({"scales": np.ones((6, 3))}, "Give either scales or log_scales"),
        ({"log_scales": None, "scales": -np.ones((6, 3))}, "scales go down to -1; give logarithms as log_scales"),
        (
            {"opacity_logits": None, "opacities": np.linspace(-3, 5, 6)},
            "from -3 to 5, not from 0 to 1; .*opacity_logits",
        ),
        ({"sh": np.zeros((6, 3, 16))}, r"sh has shape \(6, 3, 16\); \(6, any, 3\) is needed"),
        ({"sh": np.zeros((6, 5, 3))}, "K = 1, 4, 9 or 16"),
        ({"means": np.full((6, 3), np.nan)}, "means holds NaN or infinite"),
        ({"means": np.full((6, 3), 1e300)}, "means holds NaN or infinite"),
        ({"quaternions": np.zeros((6, 4))}, "Quaternion 0 has length zero"),
        ({"quaternions": np.ones((5, 4))}, r"quaternions has shape \(5, 4\); \(6, 4\) is needed"),
        ({"opacity_logits": np.zeros((6, 2))}, r"opacity_logits has shape \(6, 2\); \(6,\) is needed"),
        ({"means": "scene"}, "means is a str that NumPy cannot read"),
    ],
)
def test_arrays_that_are_no_gaussians_are_refused(change, sentence):
    with pytest.raises(gt.InputError, match=sentence):
        gt.Gaussians.from_arrays(**{**coloured(3).to_arrays(), **change})


@pytest.mark.needs("torch")
def test_tensors_of_any_device_and_type_and_with_gradients_are_arrays():
    import torch

    arrays = {name: torch.tensor(array) for name, array in coloured(2).to_arrays().items()}
    np.testing.assert_array_equal(gt.Gaussians.from_arrays(**arrays).sh_rest, coloured(2).sh_rest)
    arrays = {name: torch.nn.Parameter(array.to(torch.bfloat16)) for name, array in arrays.items()}
    expected = arrays["means"].detach().float().numpy()
    np.testing.assert_array_equal(gt.Gaussians.from_arrays(**arrays).means, expected)

    class OnDevice:  # as a tensor in a GPU's memory: NumPy cannot read it, its copy on the CPU can be
        def __array__(self, *given, **named):
            raise TypeError("can't convert cuda:0 device type tensor to numpy")

        def detach(self):
            return self

        def cpu(self):
            return torch.tensor(coloured(2).means)

    arrays["means"] = OnDevice()
    np.testing.assert_array_equal(gt.Gaussians.from_arrays(**arrays).means, coloured(2).means)


# What results can do


def test_saving_writes_what_the_command_writes(result, tmp_path):
    gt.write(SCENE, tmp_path / "scene.ply")
    np.save(tmp_path / "rough.npy", ROUGH)
    settings = ["--set", "plan.size=160", "--set", "split.rule=plane", "--refine", "off", "--background", "clean"]
    command = ["trim", tmp_path / "scene.ply", tmp_path / "rough.npy", "--up", "z", *settings, "--quiet"]
    assert run(*command, "--output", tmp_path / "command") == 0
    trimmed = gt.trim(gt.read(tmp_path / "scene.ply"), ROUGH, config=CONFIG)
    assert save(trimmed, tmp_path / "python") == tmp_path / "python"
    names = {path.relative_to(tmp_path / "python") for path in (tmp_path / "python").rglob("*")}
    assert names == {path.relative_to(tmp_path / "command") for path in (tmp_path / "command").rglob("*")}
    assert len(names) == len(result_files(".ply")) + 5  # manifest, folder of views and four more views, but no object_*
    for name in names:
        # Report and summary tell times, the manifest the report's size; archives hold the time of writing.
        if (tmp_path / "python" / name).is_file() and name.suffix not in (".json", ".npz", ".csv"):
            assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    one, other = (json.loads((tmp_path / folder / "report.json").read_text()) for folder in ("python", "command"))
    assert one.keys() - {"call"} == other.keys() - {"command"} == gt.describe(trimmed).keys()
    again = eval(one["call"], {"gaussian_trimmer": gt, "scene": gt.read(tmp_path / "scene.ply"), "selection": ROUGH})
    assert again.config == CONFIG
    np.testing.assert_array_equal(again.object.means, trimmed.object.means)
    for entry in (*one["objects"], *other["objects"]):
        entry.pop("seconds")
    for key in one.keys() - {"call", "inputs", "seconds"}:
        assert one[key] == other[key], key


def test_a_page_is_written_if_it_is_wanted(result, tmp_path):
    gt.save(result, tmp_path / "a", html=True)
    assert "default-src 'none'" in html.unescape((tmp_path / "a" / "report.html").read_text(encoding="utf-8")[:1000])


def test_saving_replaces_only_what_it_may(result, tmp_path):
    save(result, tmp_path / "trimmed")
    with pytest.raises(gt.InputError, match="not empty"):
        save(result, tmp_path / "trimmed")
    save(result, str(tmp_path / "trimmed"), overwrite=True, format="splat")
    assert (tmp_path / "trimmed" / "object.splat").is_file()
    with pytest.raises(gt.InputError, match="Unknown format 'obj'; available: ply"):
        save(result, tmp_path / "other", format="obj")
    assert not (tmp_path / "other").exists()


def test_stages_are_logged_and_no_handler_is_installed(caplog):
    stages = []
    with caplog.at_level(logging.INFO, logger="gaussian_trimmer"):
        result = gt.trim(SCENE, ROUGH, config=CONFIG, views=2, progress=stages.append)
    logged = [record for record in caplog.records if record.name == "gaussian_trimmer"]
    assert {record.levelno for record in logged} == {logging.INFO}
    lines = [record.getMessage() for record in logged]
    assert [line for line in lines if line.startswith("stage")] == [f"stage: {stage}" for stage in stages]
    assert f"object: {len(result.object)} Gaussians from a selection of {ROUGH.sum()}" in lines
    assert logging.getLogger("gaussian_trimmer").handlers == []
