"""SAM2 with random weights: what reaches the model, in which order, and what comes back. Not how well it segments."""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch", reason="needs PyTorch: the sam2 extra")
transformers = pytest.importorskip("transformers", minversion="5.6", reason="needs Transformers: the sam2 extra")
safetensors_torch = pytest.importorskip("safetensors.torch", reason="needs Transformers: the sam2 extra")

from gaussian_trimmer.cameras import Camera, intrinsics  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.masks import sam2_video as sam2  # noqa: E402
from gaussian_trimmer.masks.sam2_video import Sam2Config, Sam2Segmenter  # noqa: E402
from gaussian_trimmer.rendering import Rendering  # noqa: E402
from gaussian_trimmer.views.view import View  # noqa: E402

SIDE = 128
IMAGENET = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])
MEAN, STD = IMAGENET
# Settings that make any of the trackers small.
DECODER = {"hidden_size": 128, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 32}
TRACKER = {
    "mask_decoder_config": DECODER,
    "memory_attention_hidden_size": 128,
    "memory_attention_num_layers": 1,
    "memory_encoder_hidden_size": 128,
    "memory_encoder_output_channels": 64,
    "mask_downsampler_embed_dim": 128,
    "memory_fuser_embed_dim": 128,
    "memory_fuser_intermediate_dim": 32,
    "memory_fuser_num_layers": 1,
}


def random_model() -> "transformers.PreTrainedModel":
    """A SAM2 of a million parameters."""
    backbone = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 8,
        "image_size": [SIDE, SIDE],
        "blocks_per_stage": [1, 1, 1, 1],
        "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 1, 1, 1],
        "global_attention_blocks": [],
        "window_positional_embedding_background_size": [4, 4],
    }
    vision = {
        "model_type": "sam2_vision_model",
        "backbone_config": backbone,
        "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[SIDE // 4] * 2, [SIDE // 8] * 2, [SIDE // 16] * 2],
        "fpn_hidden_size": 128,
    }
    # Transformers 5.17 takes a dictionary with gaps for the settings of something else.
    decoder = transformers.Sam2VideoMaskDecoderConfig(**DECODER).to_dict()
    config = transformers.Sam2VideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 128, "image_size": SIDE},
        image_size=SIDE,
        memory_attention_feed_forward_hidden_size=32,
        memory_attention_rope_feat_sizes=[SIDE // 16] * 2,
        **{**TRACKER, "mask_decoder_config": decoder},
    )
    torch.manual_seed(0)
    return transformers.Sam2VideoModel(config)


def random_edgetam() -> "transformers.PreTrainedModel":
    """An EdgeTAM of a million parameters."""
    backbone = {
        "model_type": "timm_wrapper",
        "architecture": "repvit_m1",
        "num_classes": 2,
        "model_args": {
            "in_chans": 3,
            "features_only": True,
            "out_indices": [0, 1, 2, 3],
            "embed_dim": [8, 16, 32, 64],
            "depth": [1, 1, 1, 1],
        },
    }
    vision = {
        "model_type": "edgetam_vision_model",
        "backbone_config": backbone,
        "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[SIDE // 4] * 2, [SIDE // 8] * 2, [SIDE // 16] * 2],
        "fpn_hidden_size": 128,
    }
    config = transformers.EdgeTamVideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 128, "image_size": SIDE},
        image_size=SIDE,
        memory_attention_mlp_hidden_size=32,
        memory_attention_rope_feat_sizes=[SIDE // 16] * 2,
        memory_attention_rope_k_sizes=[4, 4],
        perceiver_resampler_num_latents=16,
        perceiver_resampler_num_latents_2d=16,
        **TRACKER,
    )
    torch.manual_seed(0)
    return transformers.EdgeTamVideoModel(config)


SAM3_SIDE = 112


def sam3_tracker_config() -> "transformers.PreTrainedConfig":
    backbone = {
        "model_type": "sam3_vit_model",
        "hidden_size": 32,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": SAM3_SIDE,
        "pretrain_image_size": SAM3_SIDE,
        "window_size": 4,
        "global_attn_indexes": [1],
    }
    vision = {
        "model_type": "sam3_vision_model",
        "backbone_config": backbone,
        "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        "fpn_hidden_size": 128,
    }
    return transformers.Sam3TrackerVideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 128, "image_size": SAM3_SIDE},
        image_size=SAM3_SIDE,
        memory_attention_feed_forward_hidden_size=32,
        **TRACKER,
    )


def random_sam3_tracker() -> "transformers.PreTrainedModel":
    """A tracker of SAM3 of 1.6 million parameters."""
    torch.manual_seed(0)
    return transformers.Sam3TrackerVideoModel(sam3_tracker_config())


def random_sam3() -> "transformers.PreTrainedModel":
    """A whole SAM3 of four million parameters: a detector, and a tracker that shares the detector's backbone."""
    tracker = sam3_tracker_config().to_dict()
    text = {
        "model_type": "clip_text_model",
        "vocab_size": 64,
        "bos_token_id": 0,
        "eos_token_id": 1,
        "hidden_size": 32,
        "intermediate_size": 32,
        "projection_dim": 32,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
    }
    small = {"hidden_size": 128, "intermediate_size": 32, "num_attention_heads": 2, "num_layers": 1}
    detector = {
        "vision_config": tracker["vision_config"],
        "text_config": text,
        "geometry_encoder_config": small,
        "detr_encoder_config": small,
        "detr_decoder_config": {**small, "num_queries": 4},
        "mask_decoder_config": {"hidden_size": 128, "num_attention_heads": 2},
    }
    torch.manual_seed(0)
    return transformers.Sam3VideoModel(transformers.Sam3VideoConfig(detector_config=detector, tracker_config=tracker))


@dataclass(frozen=True)
class Family:
    """A kind of checkpoint, and the pictures that its models want."""

    make: Callable[[], "transformers.PreTrainedModel"]
    side: int
    mean: np.ndarray
    std: np.ndarray


FAMILIES = {
    "sam2_video": Family(random_model, SIDE, *IMAGENET),
    "edgetam_video": Family(random_edgetam, SIDE, *IMAGENET),
    "sam3_tracker_video": Family(random_sam3_tracker, SAM3_SIDE, np.full(3, 0.5), np.full(3, 0.5)),
    "sam3_video": Family(random_sam3, SAM3_SIDE, np.full(3, 0.5), np.full(3, 0.5)),
}


@pytest.fixture(scope="module", params=FAMILIES)
def checkpoint(request, tmp_path_factory) -> tuple[Family, Path, "transformers.PreTrainedModel"]:
    """A family, a folder with one of its checkpoints, and the model that was saved in it."""
    family, path = FAMILIES[request.param], tmp_path_factory.mktemp(request.param)
    if request.param == "edgetam_video":
        pytest.importorskip("timm", reason="EdgeTAM needs the package timm")
    # Some versions ask the hub for the defaults of an EdgeTAM.
    impossible = (AttributeError, ImportError, *([OSError] if request.param == "edgetam_video" else []))
    try:
        model = family.make()
    except impossible as error:
        pytest.skip(f"this Transformers cannot make a {request.param}: {error}")
    # Written by hand: with `save_pretrained`, some versions double a prefix in the names of SAM3's weights.
    model.config.save_pretrained(path)
    weights = {name: value.contiguous() for name, value in model.state_dict().items()}
    safetensors_torch.save_file(weights, path / "model.safetensors", metadata={"format": "pt"})
    return family, path, model


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sam2")
    random_model().save_pretrained(path)
    return path


@pytest.fixture(autouse=True)
def offline(monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """So small a model loses more to the threads than it gains."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def make_segmenter(folder, **settings) -> Sam2Segmenter:
    return Sam2Segmenter(Sam2Config(**{"model": str(folder), "device": "cpu", **settings}))


def make_view(colour=(0.2, 0.5, 0.8), box=(30, 10, 60, 40), width=120, height=80) -> View:
    """A plain picture with the coarse object as a filled box."""
    silhouette = np.zeros((height, width), np.float32)
    silhouette[box[1] : box[3], box[0] : box[2]] = 1.0
    rgb = np.full((height, width, 3), colour, np.float32)
    camera = Camera(np.eye(4), intrinsics(1.0, width, height), width, height)
    whole = np.ones_like(silhouette)
    return View(camera, Rendering(rgb, whole, whole), silhouette, silhouette, silhouette, box)


def textured_views(n: int) -> list[View]:
    rng = np.random.default_rng(0)
    views = [make_view(box=(30 + 5 * i, 10, 60 + 5 * i, 40)) for i in range(n)]
    return [replace(view, picture=replace(view.picture, rgb=rng.random(view.rgb.shape, np.float32))) for view in views]


class Recorder:
    """Notes what the parts of a segmenter's model are given."""

    def __init__(self, segmenter: Sam2Segmenter) -> None:
        self.pictures: list[np.ndarray] = []
        self.corners: list[np.ndarray | None] = []
        self.masks: list[np.ndarray | None] = []
        self.logits: list[np.ndarray] = []
        model = segmenter.model
        model.vision_encoder.register_forward_pre_hook(self._picture, with_kwargs=True)
        model.prompt_encoder.register_forward_pre_hook(self._prompt, with_kwargs=True)
        model.mask_decoder.register_forward_hook(self._decoded)

    def _picture(self, module, args, kwargs):
        self.pictures.append((args[0] if args else kwargs["pixel_values"]).float().numpy()[0])

    def _prompt(self, module, args, kwargs):
        points, labels, boxes = kwargs["input_points"], kwargs["input_labels"], kwargs["input_boxes"]
        if boxes is not None:
            corners = boxes.float().numpy().reshape(2, 2)
        elif points is not None and labels.flatten().tolist() == [2, 3]:
            corners = points.float().numpy().reshape(2, 2)
        else:
            corners = None
        self.corners.append(corners)
        self.masks.append(None if kwargs["input_masks"] is None else kwargs["input_masks"].float().numpy()[0, 0])

    def _decoded(self, module, args, output):
        self.logits.append(output[0].float().numpy())


def plant_prompt_as_mask(segmenter: Sam2Segmenter) -> None:
    """Make the model answer with its prompt: logits above zero exactly inside the box, at a quarter of the side."""
    recorder = Recorder(segmenter)

    def answer(module, args, output):
        logits = torch.full_like(output[0], -1.0)
        if recorder.corners[-1] is not None:
            cells = (np.arange(SIDE // 4) + 0.5) * 4 - 0.5  # Their centres, counted as the model counts pixels.
            (x0, y0), (x1, y1) = recorder.corners[-1]
            columns, rows = (cells >= x0) & (cells <= x1), (cells >= y0) & (cells <= y1)
            logits[..., torch.from_numpy(rows[:, None] & columns[None])] = 1.0
        return (logits, *output[1:3], torch.full_like(output[3], 10.0))

    segmenter.model.mask_decoder.register_forward_hook(answer)


def recorded(folder, views, **settings) -> Recorder:
    """What a segmenter's model is given for the views, and answers."""
    segmenter = make_segmenter(folder, **settings)
    recorder = Recorder(segmenter)
    segmenter.segment(views)
    return recorder


def bounds(mask: np.ndarray) -> tuple[int, ...]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


@pytest.mark.parametrize("prompting", ["video", "per-view"])
@pytest.mark.parametrize("prompt", ["box", "mask"])
def test_masks_have_the_size_of_each_view(folder, prompting, prompt):
    views = [make_view(), make_view(width=90, height=100), make_view()]
    masks = make_segmenter(folder, prompting=prompting, prompt=prompt).segment(views)
    assert [(mask.shape, mask.dtype) for mask in masks] == [((80, 120), bool), ((100, 90), bool), ((80, 120), bool)]


@pytest.mark.parametrize("prompting", ["video", "per-view"])
@pytest.mark.parametrize(("width", "height"), [(120, 80), (80, 120), (256, 256)])
def test_the_box_comes_back_where_it_was(folder, prompting, width, height):
    box = (10, 24, 50, 36)
    segmenter = make_segmenter(folder, prompting=prompting)
    plant_prompt_as_mask(segmenter)
    mask = segmenter.segment([make_view(box=box, width=width, height=height)])[0]
    # The model answers on a grid of 32 x 32 cells, so an edge may be off by a cell of the view.
    cell = max(width, height) / (SIDE // 4)
    assert np.abs(np.subtract(bounds(mask), box)).max() <= cell


@pytest.mark.parametrize("prompting", ["video", "per-view"])
def test_corners_are_the_centres_of_the_corner_pixels(folder, prompting):
    recorder = recorded(folder, [make_view(box=(0, 0, 120, 80))], prompting=prompting)
    # Pixel centres at +0.5 in both frames; the model counts centres from zero.
    expected = [[0.5 * SIDE / 120 - 0.5, 0.5 * SIDE / 80 - 0.5], [119.5 * SIDE / 120 - 0.5, 79.5 * SIDE / 80 - 0.5]]
    np.testing.assert_allclose(recorder.corners[0], expected, atol=1e-4)


def test_a_video_is_prompted_once_and_followed_in_order_of_yaw(folder):
    colours = [(0.1, 0.2, 0.3), (0.9, 0.1, 0.4), (0.5, 0.6, 0.7), (0.3, 0.3, 0.9)]
    recorder = recorded(folder, [make_view(colour=colour) for colour in colours])
    seen = [picture.mean(axis=(1, 2)) * STD + MEAN for picture in recorder.pictures]
    np.testing.assert_allclose(seen, colours, atol=1e-5)
    assert [corners is not None for corners in recorder.corners] == [True, False, False, False]


def test_per_view_prompts_every_view_with_its_own_box(folder):
    views = [make_view(box=(12, 8, 30, 24)), make_view(box=(60, 40, 90, 56))]
    lefts = [corners[0, 0] for corners in recorded(folder, views, prompting="per-view").corners]
    np.testing.assert_allclose(lefts, [12.5 * SIDE / 120 - 0.5, 60.5 * SIDE / 120 - 0.5], atol=1e-4)


def test_a_video_prompted_by_a_mask_segments_its_first_view_at_the_end(folder):
    segmenter = make_segmenter(folder, prompt="mask")
    recorder = Recorder(segmenter)
    plant_prompt_as_mask(segmenter)  # No box is given, so every decoded view is answered with an empty mask.
    views = textured_views(3)
    masks = segmenter.segment(views)
    assert len(recorder.pictures) == 4
    np.testing.assert_array_equal(recorder.pictures[0], recorder.pictures[3])
    # Had the given mask been passed through as the answer of the first view, it would not be empty.
    assert not any(mask.any() for mask in masks)


def test_the_mask_prompt_is_the_visible_silhouette(folder):
    view = make_view(box=(30, 20, 90, 40))
    hidden = view.object_visible.copy()
    hidden[:, 60:] *= 0.4
    hidden_there = replace(view, object_visible=hidden)
    low = recorded(folder, [hidden_there], prompting="per-view", prompt="mask").masks[0] > 0
    np.testing.assert_array_equal(bounds(low), [30 / 120 * 32, 20 / 80 * 32, 60 / 120 * 32, 40 / 80 * 32])


@pytest.mark.parametrize("prompt", ["box", "mask"])
def test_views_without_the_object_get_empty_masks(folder, prompt):
    nothing = np.zeros((80, 120), np.float32)
    # As the trimmer hands it over: the box of nothing is the whole picture.
    absent = replace(make_view(), box=(0, 0, 120, 80), object_alpha=nothing, object_visible=nothing)
    alone = make_segmenter(folder, prompting="per-view", prompt=prompt)
    recorder = Recorder(alone)
    masks = alone.segment([absent, make_view()])
    assert len(recorder.pictures) == 1 and not masks[0].any()
    assert not np.any(make_segmenter(folder, prompt=prompt).segment([absent, make_view()]))


@pytest.mark.parametrize(("native", "dtype"), [(True, torch.bfloat16), (False, torch.float32)])
def test_a_gpu_computes_in_bfloat16_only_if_it_can(monkeypatch, native, dtype):
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: native or including_emulation)
    assert sam2._find_dtype(torch, "auto", torch.device("cuda")) == dtype


@pytest.mark.parametrize("prompting", ["video", "per-view"])
@pytest.mark.parametrize("prompt", ["box", "mask"])
def test_every_family_gets_its_pictures_and_prompts(checkpoint, prompting, prompt):
    family, path, model = checkpoint
    segmenter = make_segmenter(path, prompting=prompting, prompt=prompt)
    saved = {(tuple(value.shape), value.double().sum().item()) for value in model.state_dict().values()}
    loaded = {(tuple(value.shape), value.double().sum().item()) for value in segmenter.model.state_dict().values()}
    assert loaded <= saved
    recorder = Recorder(segmenter)
    masks = segmenter.segment([make_view(colour=(0.0, 0.5, 1.0), box=(12, 8, 30, 24)), make_view()])
    assert [(mask.shape, mask.dtype) for mask in masks] == [((80, 120), bool)] * 2
    assert recorder.pictures[0].shape == (3, family.side, family.side)
    seen = recorder.pictures[0].mean(axis=(1, 2)) * family.std + family.mean
    np.testing.assert_allclose(seen, [0.0, 0.5, 1.0], atol=1e-5)
    if prompt == "box" or prompting == "per-view":
        corners = np.array([[12.5 / 120, 8.5 / 80], [29.5 / 120, 23.5 / 80]]) * family.side - 0.5
        np.testing.assert_allclose(recorder.corners[0], corners, atol=1e-4)


@pytest.mark.parametrize("prompting", ["video", "per-view"])
@pytest.mark.parametrize("prompt", ["box", "mask"])
def test_bfloat16_runs_throughout(checkpoint, prompting, prompt):
    segmenter = make_segmenter(checkpoint[1], prompting=prompting, prompt=prompt, dtype="bfloat16")
    assert {parameter.dtype for parameter in segmenter.model.parameters()} == {torch.bfloat16}
    assert len(segmenter.segment(textured_views(2))) == 2


def test_a_family_whose_package_is_missing_names_it(folder, monkeypatch):
    def from_pretrained(*args, **kwargs):
        raise ImportError("\nTimmWrapperModel requires the timm library but it was not found. You can install it with")

    monkeypatch.setattr(transformers.Sam2VideoModel, "from_pretrained", from_pretrained)
    with pytest.raises(InputError, match="requires the timm library but it was not found; install it and try again"):
        make_segmenter(folder)


def test_a_transformers_that_cannot_import_its_models_says_why(folder, monkeypatch):
    class Broken(ModuleType):
        PreTrainedConfig = transformers.PreTrainedConfig

        def __getattr__(self, name):
            raise ModuleNotFoundError(f"Could not import module '{name}'.") from RuntimeError("no torchvision::nms")

    monkeypatch.setitem(sys.modules, "transformers", Broken("transformers"))
    with pytest.raises(InputError, match=r"cannot import Sam2VideoModel \(no torchvision::nms\); if the cause"):
        make_segmenter(folder)


def test_unused_devices_are_refused(folder):
    with pytest.raises(InputError, match=r"SAM2 cannot run on 'xpu'; PyTorch has here: .*cpu"):
        make_segmenter(folder, device="xpu")


@pytest.mark.parametrize("version", ["4.57.6", "5.0.0", "5.5.4"])
def test_an_old_transformers_is_named(folder, monkeypatch, version):
    monkeypatch.setattr("importlib.metadata.version", lambda name: version)
    with pytest.raises(InputError, match=rf"Transformers 5.6 or newer, and {version} is installed; run: pip install"):
        make_segmenter(folder)


def test_a_missing_extra_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(InputError, match=r'pip install "gaussian-trimmer\[sam2\]"'):
        Sam2Segmenter()


def test_an_unreachable_hub_says_what_to_do():
    with pytest.raises(InputError, match=r"'facebook/sam2.1-hiera-tiny' cannot be loaded .* --set sam2.model=FOLDER"):
        Sam2Segmenter(Sam2Config(device="cpu"))


def test_a_model_of_another_kind_is_refused(tmp_path):
    transformers.BertConfig().save_pretrained(tmp_path)
    with pytest.raises(InputError, match="is of type 'bert'; the sam2 segmenter runs sam2_video, edgetam_video"):
        make_segmenter(tmp_path)


def weights_that_could_hold_code(folder):
    torch.save(random_model().state_dict(), folder / "pytorch_model.bin")


def damaged_weights(folder):
    (folder / "model.safetensors").write_bytes(b"no weights in here")


@pytest.mark.parametrize("write", [weights_that_could_hold_code, damaged_weights])
def test_other_weights_are_refused(tmp_path, write):
    random_model().config.save_pretrained(tmp_path)
    write(tmp_path)
    with pytest.raises(InputError, match="cannot be loaded"):
        make_segmenter(tmp_path)


def test_missing_weights_are_not_made_up(tmp_path):
    model = random_model()
    model.config.save_pretrained(tmp_path)
    weights = {name: value.contiguous() for name, value in model.state_dict().items() if "memory_encoder" not in name}
    safetensors_torch.save_file(weights, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(InputError, match=r"lacks \d+ of the weights of Sam2VideoModel"):
        make_segmenter(tmp_path)
