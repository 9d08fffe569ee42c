"""Masks by SAM as ONNX files: with tiny models of both exports, whose masks can be foretold, and with trained ones."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime: the sam extra")
onnx = pytest.importorskip("onnx", reason="needs onnx: the test extra")

from benchmark_data import benchmark_scene  # noqa: E402
from tiny_sam import FAMILIES, LOW, save_tiny_sam  # noqa: E402

import gaussian_trimmer as gt  # noqa: E402
from gaussian_trimmer.cameras import Camera, intrinsics  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.masks import sam_onnx  # noqa: E402
from gaussian_trimmer.masks.sam import agreement, draw_masks, load_sam, prompt_of, sam_masks  # noqa: E402
from gaussian_trimmer.masks.sam_onnx import OnnxSam, Prompt  # noqa: E402
from gaussian_trimmer.rendering import Rendering, blend_values  # noqa: E402
from gaussian_trimmer.trimming.config import TrimConfig, paper_config  # noqa: E402
from gaussian_trimmer.trimming.trim import trim  # noqa: E402
from gaussian_trimmer.views.view import View, bounding_box  # noqa: E402

BOX, PROMPTED, RED = 0, 1, 2
SIZES = [(96, 96), (120, 60), (60, 120), (256, 256)]
MODELS = os.environ.get("GAUSSIAN_TRIMMER_MODELS", "")


def rectangle(height, width, box):
    mask = np.zeros((height, width), np.bool_)
    mask[box[1] : box[3], box[0] : box[2]] = True
    return mask


def picture(mask):
    """Red where the mask is, blue elsewhere."""
    return np.where(mask[..., None], (0.9, 0.1, 0.1), (0.1, 0.2, 0.9)).astype(np.float32)


def view(expected, red=None, box=None):
    expected = np.asarray(expected, np.float32)
    height, width = expected.shape
    blank = np.zeros((height, width), np.float32)
    camera = Camera(np.eye(4), intrinsics(1.0, width, height), width, height)
    rgb = picture(expected > 0.5 if red is None else red)
    shown = expected > 0.5
    return View(
        camera, Rendering(rgb, blank + 1, blank), shown.astype(np.float32), expected, expected,
        box or bounding_box(shown),
    )  # fmt: skip


def overlap(a, b):
    return np.count_nonzero(a & b) / max(np.count_nonzero(a | b), 1)


@pytest.fixture(params=FAMILIES)
def model(request, tmp_path):
    return OnnxSam(save_tiny_sam(tmp_path / "m", request.param))


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_box_comes_back_where_it_was_given(model, width, height):
    box = (width // 4, height // 6, 3 * width // 4, 5 * height // 6)
    truth = rectangle(height, width, box)
    found = model.propose(picture(truth), Prompt(box))
    assert found.shape == (3, height, width)
    pixel = max(width, height) / LOW
    grown = (box[0] - pixel, box[1] - pixel, box[2] + pixel, box[3] + pixel)
    shrunk = (box[0] + pixel, box[1] + pixel, box[2] - pixel, box[3] - pixel)
    mask = found[BOX] > 0
    assert not (mask & ~rectangle(height, width, [max(0, round(v)) for v in grown])).any()
    assert mask[rectangle(height, width, [round(v) for v in shrunk])].all()


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_pictures_arrive_in_place_and_colour(model, width, height):
    truth = rectangle(height, width, (0, 0, width // 2, 2 * height // 3))
    prompt = Prompt((0, 0, width, height))
    assert overlap(model.propose(picture(truth), prompt)[RED] > 0, truth) > 0.9
    mirrored = model.propose(picture(truth)[..., ::-1], prompt)[RED] > 0
    assert overlap(mirrored, truth) < 0.1  # blue is not red


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_mask_prompt_comes_back_where_it_was_given(model, width, height):
    truth = rectangle(height, width, (width // 3, 0, width, height // 2))
    given = model.propose(picture(truth), prompt_of(truth.astype(np.float32)))
    assert overlap(given[PROMPTED] > 0, truth) > 0.9
    assert (model.propose(picture(truth), Prompt((0, 0, 4, 4)))[PROMPTED] == -1).all()


def test_agreement_is_the_overlap_with_shares():
    share = np.array([[1.0, 1.0, 0.5, 0.0]], np.float32)
    assert agreement(np.array([[True, True, False, False]]), share) == pytest.approx(2 / 2.5)
    assert agreement(np.zeros((1, 4), np.bool_), share) == 0


@pytest.mark.parametrize("paper", [False, True])
def test_the_mask_that_agrees_best_is_taken_whatever_the_model_scores(tmp_path, paper):
    """The box is too wide, and scored highest; what is red is right."""
    model = OnnxSam(save_tiny_sam(tmp_path, "sam2", scores=(0.9, 0.5, 0.6)))
    slanted = rectangle(96, 96, (20, 20, 70, 60)) & (np.add(*np.indices((96, 96))) < 110)
    ((_, mask),) = sam_masks(model, [view(slanted, red=slanted, box=(20, 20, 70, 60))], red_ball()[0], paper=paper)
    assert overlap(mask, slanted) > 0.85


@pytest.mark.parametrize("paper", [False, True])
def test_where_nothing_is_expected_the_mask_is_empty_and_nothing_is_encoded(tmp_path, monkeypatch, paper):
    model = OnnxSam(save_tiny_sam(tmp_path, "sam"))
    monkeypatch.setattr(model, "propose", lambda rgb, prompt: pytest.fail("encoded"))
    ((_, mask),) = sam_masks(model, [view(np.zeros((48, 64)), box=(0, 0, 64, 48))], red_ball()[0], paper=paper)
    assert mask.shape == (48, 64)
    assert not mask.any()


def red_ball():
    """A red ball on a blue floor, z up, and a selection that takes some of the floor along."""
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(1500, 3))
    ball = 0.5 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + (0, 0, 0.5)
    floor = np.column_stack([rng.uniform(-2, 2, (6000, 2)), np.zeros(6000)])
    means = np.concatenate([ball, floor])
    colours = np.where(np.arange(len(means))[:, None] < 1500, (0.9, 0.1, 0.1), (0.1, 0.2, 0.9))
    scene = gt.Gaussians.from_arrays(
        means, np.tile([1.0, 0, 0, 0], (len(means), 1)), (colours[:, None] - 0.5) / 0.28209479,
        scales=np.full((len(means), 3), 0.03), opacities=np.full(len(means), 0.95),
    )  # fmt: skip
    truth = np.arange(len(means)) < 1500
    return scene, truth, truth | (np.linalg.norm(means - (0, 0, 0.5), axis=1) < 0.75)


def test_a_trim_with_sam_finds_the_object_and_reports_its_progress(tmp_path):
    scene, truth, rough = red_ball()
    stages, given = [], {"views": 3, "up": "z"}
    masks = draw_masks(scene, rough, sam=save_tiny_sam(tmp_path, "sam2"), progress=stages.append, **given)
    result = trim(scene, rough, masks=masks, **given)
    assert not result.objects[0].refused and all(view.judged for view in result.objects[0].views)
    assert overlap(result.object_mask, truth) > max(0.9, overlap(rough, truth) + 0.02)
    assert stages == ["segment 1 of 3", "segment 2 of 3", "segment 3 of 3"]


@pytest.mark.parametrize("wrong", [False, True])
def test_views_after_the_first_are_prompted_with_what_its_mask_says(tmp_path, wrong):
    """What is red is right, but the rough selection is wider; a first mask of something else is not followed."""
    scene, truth, rough = red_ball()
    model = OnnxSam(save_tiny_sam(tmp_path, "sam2"))
    prompts, propose = [], model.propose
    model.propose = lambda rgb, prompt: prompts.append(prompt) or propose(rgb * (0 if wrong else 1), prompt)[[RED]]
    given = {"up": "z", "config": replace(paper_config(), plan=TrimConfig().plan)}
    masks = draw_masks(scene, rough, sam=model, paper=True, **given)
    assert prompts[0].logits is None  # by the box alone, eq. 6
    if wrong:  # nothing is red, so there is nothing to follow
        assert all(prompt.logits is None for prompt in prompts)
        return
    for prompt, (camera, _) in zip(prompts[1:], masks[1:], strict=True):
        shares = np.column_stack([truth, rough]).astype(np.float32)
        shown = blend_values(scene, camera, shares) > 0.5
        gained = overlap(prompt.logits > 0, shown[..., 0]) - overlap(shown[..., 1], shown[..., 0])
        assert gained > 0.04  # what the first mask left out is left out of the prompts of the others
    result = trim(scene, rough, masks=masks, **given)
    assert not result.objects[0].refused and overlap(result.object_mask, truth) > overlap(rough, truth) + 0.09


def refused(folder):
    with pytest.raises(InputError) as error:
        load_sam(Path(folder))
    message = str(error.value)
    assert "\n" not in message
    return message


def test_without_onnx_runtime_the_extra_is_named(tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(f"No module named '{name}'")

    save_tiny_sam(tmp_path, "sam")
    monkeypatch.setattr(sam_onnx, "import_module", missing)
    assert "in the program's clone: pip install '.[sam]'" in refused(tmp_path)


def test_folders_without_a_model_are_refused(tmp_path):
    assert "nowhere' cannot be read" in refused(tmp_path / "nowhere")
    assert "an encoder with that word in its name and a decoder; it holds none" in refused(tmp_path)
    save_tiny_sam(tmp_path, "sam")
    (tmp_path / "decoder.onnx").rename(tmp_path / "other.txt")
    assert "it holds encoder.onnx" in refused(tmp_path)


@pytest.mark.parametrize("content", [b"", b"no model", b"\x08\x08" + bytes(1000)])
@pytest.mark.parametrize("name", ["encoder.onnx", "decoder.onnx"])
def test_files_that_are_no_models_are_refused(tmp_path, name, content):
    save_tiny_sam(tmp_path, "sam")
    (tmp_path / name).write_bytes(content)
    assert name in refused(tmp_path)


def test_files_that_do_not_go_together_are_refused(tmp_path):
    save_tiny_sam(tmp_path / "a", "sam")
    save_tiny_sam(tmp_path / "b", "sam2")
    (tmp_path / "a" / "decoder.onnx").rename(tmp_path / "a" / "sam_vit_b_01ec64.onnx")  # as the original export does
    assert not OnnxSam(tmp_path / "a").is_sam2
    (tmp_path / "a" / "sam_vit_b_01ec64.onnx").write_bytes((tmp_path / "b" / "decoder.onnx").read_bytes())
    assert "one export" in refused(tmp_path / "a")
    (tmp_path / "b" / "encoder.onnx").write_bytes((tmp_path / "b" / "decoder.onnx").read_bytes())
    assert "not an encoder of a picture" in refused(tmp_path / "b")


def test_a_model_that_gives_no_numbers_is_refused(tmp_path, monkeypatch):
    model = OnnxSam(save_tiny_sam(tmp_path, "sam2"))
    shown, run = picture(rectangle(32, 32, (4, 4, 20, 20))), model._run
    monkeypatch.setattr(model, "_run", lambda *a: [run(*a)[0] * np.nan, *run(*a)[1:]])
    with pytest.raises(InputError, match="finite numbers"):
        model.propose(shown, Prompt((0, 0, 9, 9)))


def test_a_model_that_fails_while_it_runs_is_one_sentence(tmp_path):
    model = OnnxSam(save_tiny_sam(tmp_path, "sam"))
    model.side = 64
    with pytest.raises(InputError, match=r"coder.onnx' cannot be run"):
        model.propose(picture(rectangle(32, 32, (4, 4, 20, 20))), Prompt((0, 0, 9, 9)))


@pytest.mark.skipif(not MODELS, reason="GAUSSIAN_TRIMMER_MODELS names no folder of trained models")
def test_trained_models_improve_a_trim():
    """Each folder of `GAUSSIAN_TRIMMER_MODELS` that has an encoder; MobileSAM and SAM 2 tiny are known to pass."""
    folders = [path for path in sorted(Path(MODELS).iterdir()) if any(path.glob("*encoder*.o*"))]
    assert folders
    scene = benchmark_scene("tabletop")
    coarse, exact = (scene.coarse("lighthouse", kind) for kind in ("dilated", "exact"))
    for folder in folders:
        masks = draw_masks(scene.gaussians, coarse, sam=folder, views=2, up="z")
        result = trim(scene.gaussians, coarse, masks=masks, views=2, up="z")
        assert not result.objects[0].refused
        assert overlap(result.object_mask, exact) > overlap(coarse, exact) + 0.05
