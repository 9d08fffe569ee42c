"""The segmenter sam, with tiny models of every family whose masks can be foretold, and with trained ones."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime: the sam extra")
onnx = pytest.importorskip("onnx", reason="needs onnx: the test extra")

import tiny_sam  # noqa: E402
from benchmark_data import benchmark_scene  # noqa: E402
from tiny_sam import FAMILIES, LOW, SIDE, save_tiny_sam  # noqa: E402

import gaussian_trimmer as gt  # noqa: E402
from gaussian_trimmer.cameras import Camera, intrinsics  # noqa: E402
from gaussian_trimmer.commands import parser_of  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.masks import get_segmenter, sam_onnx  # noqa: E402
from gaussian_trimmer.masks.prompts import Prompt, expected_logits, middle_points  # noqa: E402
from gaussian_trimmer.masks.sam import SamConfig, SamSegmenter, agreement, paper_sam, prompt_of  # noqa: E402
from gaussian_trimmer.masks.sam_onnx import OnnxSam  # noqa: E402
from gaussian_trimmer.rendering import Rendering, blend_values  # noqa: E402
from gaussian_trimmer.trim_arguments import segmenter_name, segmenter_options  # noqa: E402
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
    return OnnxSam(save_tiny_sam(tmp_path / "m", request.param), "cpu")


def test_families_are_told_apart_by_names_alone(tmp_path):
    found = {family: OnnxSam(save_tiny_sam(tmp_path / family, family)).family for family in FAMILIES}
    assert found == {
        "sam2": "SAM 2, original export",
        "sam": "SAM, original export",
        "transformers-sam2": "SAM 2, Transformers.js export",
        "transformers-sam": "SAM, Transformers.js export",
    }


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_box_comes_back_where_it_was_given(model, width, height):
    box = (width // 4, height // 6, 3 * width // 4, 5 * height // 6)
    truth = rectangle(height, width, box)
    prompt = Prompt(box)
    if not model.takes_box:  # such decoders know points alone, of which the tiny ones take the first two for corners
        prompt = Prompt(points=prompt.corners(), inside=np.ones(2, np.bool_))
    found = model.decode(model.encode(picture(truth)), prompt)
    assert found.logits.shape == (3, height, width)
    assert found.scores == pytest.approx(tiny_sam.SCORES)
    pixel = max(width, height) / LOW
    grown = (box[0] - pixel, box[1] - pixel, box[2] + pixel, box[3] + pixel)
    shrunk = (box[0] + pixel, box[1] + pixel, box[2] - pixel, box[3] - pixel)
    mask = found.logits[BOX] > 0
    assert not (mask & ~rectangle(height, width, [max(0, round(v)) for v in grown])).any()
    assert mask[rectangle(height, width, [round(v) for v in shrunk])].all()


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_pictures_arrive_in_place_and_colour(model, width, height):
    truth = rectangle(height, width, (0, 0, width // 2, 2 * height // 3))
    prompt = Prompt((0, 0, width, height), np.array([[1.0, 1.0], [2.0, 2.0]]), np.ones(2, np.bool_))
    red = model.decode(model.encode(picture(truth)), prompt).logits[RED] > 0
    assert overlap(red, truth) > 0.9
    mirrored = model.decode(model.encode(picture(truth)[..., ::-1]), prompt).logits[RED] > 0
    assert overlap(mirrored, truth) < 0.1  # blue is not red


@pytest.mark.parametrize("family", ["sam", "sam2"])
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_mask_prompt_comes_back_where_it_was_given(tmp_path, family, width, height):
    model = OnnxSam(save_tiny_sam(tmp_path, family))
    truth = rectangle(height, width, (width // 3, 0, width, height // 2))
    embedding = model.encode(picture(truth))
    given = model.decode(embedding, Prompt((0, 0, 4, 4), logits=expected_logits(truth.astype(np.float32))))
    assert overlap(given.logits[PROMPTED] > 0, truth) > 0.9
    assert (model.decode(embedding, Prompt((0, 0, 4, 4))).logits[PROMPTED] == -1).all()


@pytest.mark.parametrize("dtype", [onnx.TensorProto.FLOAT16, onnx.TensorProto.DOUBLE])
def test_models_of_other_number_types_are_fed_in_theirs(tmp_path, dtype):
    save_tiny_sam(tmp_path, "sam")
    encoder = onnx.load(tmp_path / "encoder.onnx")
    cast = onnx.helper.make_node("Cast", ["images"], ["images_float"], to=onnx.TensorProto.FLOAT)
    encoder.graph.input[0].type.tensor_type.elem_type = dtype
    for node in encoder.graph.node:
        node.input[:] = ["images_float" if name == "images" else name for name in node.input]
    encoder.graph.node.insert(0, cast)
    onnx.save(encoder, tmp_path / "encoder.onnx")
    truth = rectangle(60, 60, (10, 10, 40, 50))
    found = OnnxSam(tmp_path).decode(OnnxSam(tmp_path).encode(picture(truth)), Prompt((0, 0, 9, 9)))
    assert overlap(found.logits[RED] > 0, truth) > 0.85


def test_encoders_that_normalise_themselves_get_plain_pixels(tmp_path):
    save_tiny_sam(tmp_path, "sam")
    helper, floats = onnx.helper, tiny_sam._floats
    nodes = [
        helper.make_node("Transpose", ["input_image"], ["channels"], perm=[2, 0, 1]),
        helper.make_node("Reshape", ["channels", "shape"], ["batch"]),
        helper.make_node("Pad", ["batch", "pads"], ["padded"]),
        helper.make_node("Div", ["padded", "scale"], ["scaled"]),
        helper.make_node("AveragePool", ["scaled"], ["image_embeddings"], kernel_shape=[4, 4], strides=[4, 4]),
    ]
    constants = {
        "shape": np.array([1, 3, SIDE // 2, SIDE]),
        "pads": np.array([0, 0, 0, 0, 0, 0, SIDE // 2, 0]),
        "scale": np.full(1, 64.0, np.float32),
    }
    inputs = [floats("input_image", ("height", "width", 3))]
    outputs = [floats("image_embeddings", (1, 3, LOW, LOW))]
    onnx.save(tiny_sam._model(nodes, inputs, outputs, constants), tmp_path / "encoder.onnx")
    model = OnnxSam(tmp_path)
    model.side = SIDE  # it states none, and would be the usual 1024
    truth = rectangle(50, 100, (20, 10, 60, 40))
    found = model.decode(model.encode(picture(truth)), Prompt((0, 0, 9, 9)))
    assert overlap(found.logits[RED] > 0, truth) > 0.85


def test_embeddings_under_other_names_are_matched_by_shape(tmp_path):
    save_tiny_sam(tmp_path, "sam")
    encoder = onnx.load(tmp_path / "encoder.onnx")
    for node in encoder.graph.node:
        node.output[:] = ["features" if name == "image_embeddings" else name for name in node.output]
    encoder.graph.output[0].name = "features"
    onnx.save(encoder, tmp_path / "encoder.onnx")
    truth = rectangle(40, 40, (5, 5, 30, 30))
    model = OnnxSam(tmp_path)
    assert overlap(model.decode(model.encode(picture(truth)), Prompt((0, 0, 9, 9))).logits[RED] > 0, truth) > 0.8


def test_points_lie_deep_inside_and_apart():
    region = rectangle(60, 100, (10, 10, 90, 50))
    points = middle_points(region, 3)
    assert len(points) == 3
    assert all(region[int(y), int(x)] for x, y in points)
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)[np.triu_indices(3, 1)]
    assert apart.min() > 15
    assert len(middle_points(np.zeros((9, 9), np.bool_), 3)) == 0


def test_the_prompt_says_what_the_labels_expect():
    expected = rectangle(64, 64, (16, 8, 48, 56)).astype(np.float32)
    assert len(prompt_of(expected).points) == 0
    prompt = prompt_of(expected, points=3)
    assert prompt.box == (16, 8, 48, 56)
    assert prompt.inside.sum() == 3
    assert all(expected[int(y), int(x)] for x, y in prompt.points[prompt.inside])
    assert ((prompt.logits > 0) == (expected > 0.5)).all()
    assert prompt_of(np.zeros((64, 64), np.float32)) is None


def test_agreement_is_the_overlap_with_shares():
    share = np.array([[1.0, 1.0, 0.5, 0.0]], np.float32)
    assert agreement(np.array([[True, True, False, False]]), share) == pytest.approx(2 / 2.5)
    assert agreement(np.zeros((1, 4), np.bool_), share) == 0


@pytest.mark.parametrize(("choice", "taken"), [("agreement", RED), ("score", PROMPTED)])
def test_the_mask_that_agrees_or_scores_best_is_taken(tmp_path, choice, taken):
    """The box is too wide and scored low; the prompted mask misses, and is scored high; what is red is right."""
    save_tiny_sam(tmp_path, "transformers-sam2", scores=(0.5, 0.9, 0.6))
    expected = rectangle(96, 96, (20, 20, 70, 60))
    slanted = expected & (np.add(*np.indices((96, 96))) < 110)
    (mask,) = SamSegmenter(SamConfig(str(tmp_path), choice=choice)).segment([view(slanted, red=slanted)])
    assert (overlap(mask, slanted) > 0.85) == (taken == RED)
    assert taken == RED or not mask.any()


@pytest.mark.parametrize("prompt", ["expected", "box"])
def test_where_nothing_is_expected_the_mask_is_empty_and_nothing_is_encoded(tmp_path, monkeypatch, prompt):
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path, "sam")), prompt=prompt))
    monkeypatch.setattr(segmenter.model, "encode", lambda rgb: pytest.fail("encoded"))
    (mask,) = segmenter.segment([view(np.zeros((48, 64)), box=(0, 0, 64, 48))])
    assert mask.shape == (48, 64)
    assert not mask.any()


def test_a_view_is_encoded_once_however_often_it_is_prompted(tmp_path, monkeypatch):
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path, "sam"))))
    encode, encoded = segmenter.model.encode, []
    monkeypatch.setattr(segmenter.model, "encode", lambda rgb: encoded.append(rgb) or encode(rgb))
    first, second = view(rectangle(64, 64, (8, 8, 40, 40))), view(rectangle(64, 64, (8, 8, 40, 48)))
    for _ in range(2):
        segmenter.segment([first, second])
    assert len(encoded) == 2
    segmenter.forget()
    segmenter.segment([first])
    assert len(encoded) == 3
    monkeypatch.setattr("gaussian_trimmer.masks.sam._KEPT_BYTES", 1)
    segmenter.segment([view(rectangle(64, 64, (8, 8, 48, 48)))])
    assert len(segmenter._embeddings) == 1


def test_progress_is_told_view_by_view(tmp_path):
    segmenter, parts = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path, "sam")))), []
    segmenter.report_to(parts.append)
    segmenter.segment([view(rectangle(64, 64, (8, 8, 40, 40)))] * 3)
    assert parts == ["1 of 3", "2 of 3", "3 of 3"]


def test_decoders_without_silhouettes_get_points(tmp_path):
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path / "a", "transformers-sam2"))))
    assert len(segmenter._prompt(view(rectangle(64, 64, (8, 8, 40, 40)))).points) == 3
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path / "b", "sam2"))))
    assert len(segmenter._prompt(view(rectangle(64, 64, (8, 8, 40, 40)))).points) == 0


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


@pytest.mark.parametrize("fusion", [True, False])
def test_a_trim_with_sam_finds_the_object_and_reports_its_progress(tmp_path, fusion):
    scene, truth, rough = red_ball()
    stages = []
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path, "sam2")), fusion=fusion))
    result = trim(scene, rough, views=3, up="z", segmenter=segmenter, progress=stages.append)
    assert not result.objects[0].refused
    assert overlap(result.object_mask, truth) > max(0.9, overlap(rough, truth) + 0.02)
    assert [stage for stage in stages if stage.startswith("segment ")] == [
        "segment 1 of 3",
        "segment 2 of 3",
        "segment 3 of 3",
    ]
    assert ("fused" in segmenter.describe()) == fusion


@pytest.mark.parametrize("wrong", [False, True])
def test_views_after_the_first_are_prompted_with_what_its_mask_says(tmp_path, wrong):
    """What is red is right, but the rough selection is wider; a first mask of something else is not followed."""
    scene, truth, rough = red_ball()
    scores = (0.1, 0.2, 0.9)
    segmenter = SamSegmenter(paper_sam(SamConfig(str(save_tiny_sam(tmp_path, "sam2", scores)))))
    prompts, propose = [], segmenter.propose
    segmenter.propose = lambda rgb, prompt: prompts.append(prompt) or propose(rgb * (0 if wrong else 1), prompt)
    config = replace(paper_config(), plan=TrimConfig().plan)
    result = trim(scene, rough, up="z", config=config, segmenter=segmenter)
    assert prompts[0].logits is None  # by the box alone, eq. 6
    if wrong:  # nothing is red, so there is nothing to follow
        assert all(prompt.logits is None for prompt in prompts)
        return
    for prompt, trimmed in zip(prompts[1:], result.objects[0].views[1:], strict=True):
        shares = np.column_stack([truth, rough]).astype(np.float32)
        shown = blend_values(scene, trimmed.view.camera, shares) > 0.5
        gained = overlap(prompt.logits > 0, shown[..., 0]) - overlap(shown[..., 1], shown[..., 0])
        assert gained > 0.04  # what the first mask left out is left out of the prompts of the others
    assert not result.objects[0].refused and overlap(result.object_mask, truth) > overlap(rough, truth) + 0.09


def test_masks_of_something_else_are_told_in_the_report(tmp_path):
    """Nothing is red, so the red mask is empty, and the box's mask is left out."""
    scene, _, rough = red_ball()
    grey = replace(scene, sh_dc=np.zeros_like(scene.sh_dc))
    segmenter = SamSegmenter(SamConfig(str(save_tiny_sam(tmp_path, "sam2", (0.1, 0.1, 0.9))), choice="score"))
    result = trim(grey, rough, views=3, up="z", segmenter=segmenter)
    assert "3 of 3 masks set aside" in segmenter.describe()
    assert not result.objects[0].refused


def test_the_papers_preset_takes_the_papers_prompt(tmp_path):
    words = ["scene.ply", "--preset", "paper", "--segmenter", "sam", "--set", "sam.model=m"]
    paper = segmenter_options(parser_of("trim").parse(words))
    assert paper == SamConfig("m", prompt="follow", choice="score", fusion=False)
    changed = parser_of("trim").parse([*words, "--set", "sam.prompt=expected"])
    assert segmenter_options(changed).prompt == "expected"
    assert segmenter_name(parser_of("trim").parse(["scene.ply", "--preset", "paper"])) == "grabcut"


def test_files_are_found_in_the_folder_onnx_and_under_the_names_of_checkpoints(tmp_path):
    save_tiny_sam(tmp_path / "hub" / "onnx", "transformers-sam2")
    assert OnnxSam(tmp_path / "hub").is_sam2
    save_tiny_sam(tmp_path / "own", "sam")
    (tmp_path / "own" / "decoder.onnx").rename(tmp_path / "own" / "sam_vit_b_01ec64.onnx")
    assert not OnnxSam(tmp_path / "own").is_sam2


def refused(folder, provider="auto"):
    with pytest.raises(InputError) as error:
        OnnxSam(Path(folder), provider)
    message = str(error.value)
    assert "\n" not in message
    return message


def test_without_a_model_the_message_says_how_to_get_one():
    with pytest.raises(InputError, match=r"--set sam.model=FOLDER.*docs/sam\.md"):
        get_segmenter("sam")


def test_without_onnx_runtime_the_extra_is_named(tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(f"No module named '{name}'")

    save_tiny_sam(tmp_path, "sam")
    monkeypatch.setattr(sam_onnx, "import_module", missing)
    assert 'pip install "gaussian-trimmer[sam]"' in refused(tmp_path)


def test_folders_without_a_model_are_refused(tmp_path):
    assert "no folder" in refused(tmp_path / "nowhere")
    assert "no .onnx or .ort file with 'encoder'" in refused(tmp_path)
    assert "\\x00" in refused("a\0b") or "no folder" in refused("a\0b")
    save_tiny_sam(tmp_path, "sam")
    (tmp_path / "decoder.onnx").rename(tmp_path / "other.txt")
    assert "'decoder'" in refused(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="This system has no pipes with names.")
def test_only_regular_files_are_models(tmp_path):
    for name in ("encoder.onnx", "decoder.onnx"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=r"has no \.onnx or \.ort file with 'encoder' in its name"):
        OnnxSam(tmp_path)


@pytest.mark.parametrize("content", [b"", b"no model", b"\x08\x08" + bytes(1000)])
@pytest.mark.parametrize("name", ["encoder.onnx", "decoder.onnx"])
def test_files_that_are_no_models_are_refused(tmp_path, name, content):
    save_tiny_sam(tmp_path, "sam")
    (tmp_path / name).write_bytes(content)
    assert name in refused(tmp_path)


def test_truncated_models_are_refused(tmp_path):
    save_tiny_sam(tmp_path, "sam2")
    whole = (tmp_path / "decoder.onnx").read_bytes()
    for length in range(1, len(whole), max(1, len(whole) // 40)):
        (tmp_path / "decoder.onnx").write_bytes(whole[:length])
        assert "decoder.onnx" in refused(tmp_path)


def test_files_of_two_exports_do_not_go_together(tmp_path):
    save_tiny_sam(tmp_path / "a", "sam")
    save_tiny_sam(tmp_path / "b", "sam2")
    (tmp_path / "a" / "decoder.onnx").write_bytes((tmp_path / "b" / "decoder.onnx").read_bytes())
    assert "one export" in refused(tmp_path / "a")


def test_an_encoder_that_is_a_decoder_is_refused(tmp_path):
    save_tiny_sam(tmp_path, "sam")
    (tmp_path / "encoder.onnx").write_bytes((tmp_path / "decoder.onnx").read_bytes())
    assert "not an encoder of a picture" in refused(tmp_path)


@pytest.mark.parametrize("side", [16, 8192])
def test_pictures_of_absurd_sizes_are_refused(tmp_path, side):
    save_tiny_sam(tmp_path, "sam")
    onnx.save(tiny_sam.encoder("sam", side), tmp_path / "encoder.onnx")
    assert f"{side} x {side}" in refused(tmp_path) or "encoder.onnx" in refused(tmp_path)


def test_providers_that_are_not_there_are_refused_with_those_that_are(tmp_path):
    save_tiny_sam(tmp_path, "sam")
    missing = next(name for name in ("directml", "coreml", "cuda") if sam_onnx.PROVIDERS[name] not in providers())
    assert f"'{missing}'; it has: " in refused(tmp_path, missing)


def providers():
    import onnxruntime

    return onnxruntime.get_available_providers()


def test_a_model_that_gives_no_numbers_is_refused(tmp_path, monkeypatch):
    model = OnnxSam(save_tiny_sam(tmp_path, "sam2"))
    embedding = model.encode(picture(rectangle(32, 32, (4, 4, 20, 20))))
    run = model._run
    monkeypatch.setattr(model, "_run", lambda *a: [run(*a)[0] * np.nan, *run(*a)[1:]])
    with pytest.raises(InputError, match="finite numbers"):
        model.decode(embedding, Prompt((0, 0, 9, 9)))
    monkeypatch.setattr(model, "_run", lambda *a: [run(*a)[0], np.zeros(5, np.float32)])
    with pytest.raises(InputError, match="5 scores for 3 masks"):
        model.decode(embedding, Prompt((0, 0, 9, 9)))


def test_a_model_that_fails_while_it_runs_is_one_sentence(tmp_path):
    model = OnnxSam(save_tiny_sam(tmp_path, "sam"))
    model.side = 64
    with pytest.raises(InputError, match=r"encoder.onnx' cannot be run"):
        model.encode(picture(rectangle(32, 32, (4, 4, 20, 20))))


@pytest.mark.skipif(not MODELS, reason="GAUSSIAN_TRIMMER_MODELS names no folder of trained models")
def test_trained_models_improve_a_trim():
    """Each folder of `GAUSSIAN_TRIMMER_MODELS` that has an encoder; MobileSAM and SAM 2 tiny are known to pass."""
    folders = [path for path in sorted(Path(MODELS).iterdir()) if any(path.glob("*encoder*.o*"))]
    assert folders
    scene = benchmark_scene("tabletop")
    coarse, exact = (scene.coarse("lighthouse", kind) for kind in ("dilated", "exact"))
    for folder in folders:
        result = trim(scene.gaussians, coarse, views=2, up="z", segmenter=SamSegmenter(SamConfig(str(folder))))
        assert not result.objects[0].refused
        assert overlap(result.object_mask, exact) > overlap(coarse, exact) + 0.05
