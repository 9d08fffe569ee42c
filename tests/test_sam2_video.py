"""SAM2 with random weights: what reaches the model, in which order, and what comes back. Not how well it segments."""

import os
import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch", reason="needs PyTorch: the sam2 extra")
transformers = pytest.importorskip("transformers", minversion="5.6", reason="needs Transformers: the sam2 extra")
safetensors_torch = pytest.importorskip("safetensors.torch", reason="needs Transformers: the sam2 extra")

from gaussian_trimmer.cameras import Camera, intrinsics  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.masks.sam import load_sam, sam_masks  # noqa: E402
from gaussian_trimmer.masks.sam2_video import Sam2Video  # noqa: E402
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
    ones = [1, 1, 1, 1]
    backbone = {
        "model_type": "sam2_hiera_det_model", "hidden_size": 8, "image_size": [SIDE, SIDE], "blocks_per_stage": ones,
        "embed_dim_per_stage": [8, 16, 32, 64], "num_attention_heads_per_stage": ones, "global_attention_blocks": [],
        "window_positional_embedding_background_size": [4, 4],
    }  # fmt: skip
    vision = {
        "model_type": "sam2_vision_model", "backbone_config": backbone, "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[SIDE // 4] * 2, [SIDE // 8] * 2, [SIDE // 16] * 2], "fpn_hidden_size": 128,
    }  # fmt: skip
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


def make_view(colour=(0.2, 0.5, 0.8), box=(30, 10, 60, 40), width=120, height=80) -> View:
    """A plain picture with the coarse object as a filled box."""
    silhouette = np.zeros((height, width), np.float32)
    silhouette[box[1] : box[3], box[0] : box[2]] = 1.0
    rgb = np.full((height, width, 3), colour, np.float32)
    camera = Camera(np.eye(4), intrinsics(1.0, width, height), width, height)
    whole = np.ones_like(silhouette)
    return View(camera, Rendering(rgb, whole, whole), silhouette, silhouette, silhouette, box)


class Recorder:
    """Notes what the parts of a model are given."""

    def __init__(self, video: Sam2Video) -> None:
        self.pictures: list[np.ndarray] = []
        self.corners: list[np.ndarray | None] = []
        model = video.model
        model.vision_encoder.register_forward_pre_hook(self._picture, with_kwargs=True)
        model.prompt_encoder.register_forward_pre_hook(self._prompt, with_kwargs=True)

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


def plant_prompt_as_mask(video: Sam2Video) -> None:
    """Make the model answer with its prompt: logits above zero exactly inside the box, at a quarter of the side."""
    recorder = Recorder(video)

    def answer(module, args, output):
        logits = torch.full_like(output[0], -1.0)
        if recorder.corners[-1] is not None:
            cells = (np.arange(SIDE // 4) + 0.5) * 4 - 0.5  # Their centres, counted as the model counts pixels.
            (x0, y0), (x1, y1) = recorder.corners[-1]
            columns, rows = (cells >= x0) & (cells <= x1), (cells >= y0) & (cells <= y1)
            logits[..., torch.from_numpy(rows[:, None] & columns[None])] = 1.0
        return (logits, *output[1:3], torch.full_like(output[3], 10.0))

    video.model.mask_decoder.register_forward_hook(answer)


def bounds(mask: np.ndarray) -> tuple[int, ...]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def test_masks_have_the_size_of_each_view(folder):
    views = [make_view(), make_view(width=90, height=100), make_view()]
    logits = load_sam(folder).follow(views)
    assert [(mask.shape, mask.dtype) for mask in logits] == [((80, 120), "f4"), ((100, 90), "f4"), ((80, 120), "f4")]
    pairs = sam_masks(load_sam(folder), views, None, paper=True)
    assert [camera for camera, _ in pairs] == [view.camera for view in views]
    for (_, mask), logit in zip(pairs, logits, strict=True):
        np.testing.assert_array_equal(mask, logit > 0)


@pytest.mark.parametrize(("width", "height"), [(120, 80), (80, 120), (256, 256)])
def test_the_box_comes_back_where_it_was(folder, width, height):
    box, video = (10, 24, 50, 36), Sam2Video(folder)
    plant_prompt_as_mask(video)
    (logits,) = video.follow([make_view(box=box, width=width, height=height)])
    # The model answers on a grid of 32 x 32 cells, so an edge may be off by a cell of the view.
    cell = max(width, height) / (SIDE // 4)
    assert np.abs(np.subtract(bounds(logits > 0), box)).max() <= cell


def test_corners_are_the_centres_of_the_corner_pixels(folder):
    video = Sam2Video(folder)
    recorder = Recorder(video)
    video.follow([make_view(box=(0, 0, 120, 80))])
    # Pixel centres at +0.5 in both frames; the model counts centres from zero.
    expected = [[0.5 * SIDE / 120 - 0.5, 0.5 * SIDE / 80 - 0.5], [119.5 * SIDE / 120 - 0.5, 79.5 * SIDE / 80 - 0.5]]
    np.testing.assert_allclose(recorder.corners[0], expected, atol=1e-4)


def test_a_video_is_prompted_once_and_followed_in_order_of_yaw(folder):
    colours = [(0.1, 0.2, 0.3), (0.9, 0.1, 0.4), (0.5, 0.6, 0.7), (0.3, 0.3, 0.9)]
    video = Sam2Video(folder)
    recorder = Recorder(video)
    video.follow([make_view(colour=colour) for colour in colours])
    seen = [picture.mean(axis=(1, 2)) * STD + MEAN for picture in recorder.pictures]
    np.testing.assert_allclose(seen, colours, atol=1e-5)
    assert [corners is not None for corners in recorder.corners] == [True, False, False, False]


def test_a_first_view_without_the_object_gives_empty_masks(folder):
    nothing = np.zeros((80, 120), np.float32)
    # As the trimmer hands it over: the box of nothing is the whole picture.
    absent = replace(make_view(), box=(0, 0, 120, 80), object_alpha=nothing, object_visible=nothing)
    assert all((logits < 0).all() for logits in Sam2Video(folder).follow([absent, make_view()]))


def test_a_transformers_that_cannot_import_its_models_says_why(folder, monkeypatch):
    class Broken(ModuleType):
        PreTrainedConfig = transformers.PreTrainedConfig

        def __getattr__(self, name):
            raise ModuleNotFoundError(f"Could not import module '{name}'.") from RuntimeError("no torchvision::nms")

    monkeypatch.setitem(sys.modules, "transformers", Broken("transformers"))
    with pytest.raises(InputError, match=r"cannot import Sam2VideoModel \(no torchvision::nms\); if the cause"):
        Sam2Video(folder)


def test_what_is_missing_or_too_old_is_named(folder, tmp_path, monkeypatch):
    transformers.BertConfig().save_pretrained(tmp_path)
    with pytest.raises(InputError, match="is of type 'bert'; sam2_video is needed"):
        Sam2Video(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("importlib.metadata.version", lambda name: "5.5.4")
        with pytest.raises(InputError, match=r"Transformers 5.6 or newer, and 5.5.4 is installed; run: pip install"):
            Sam2Video(folder)
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(InputError, match=r"in the program's clone: pip install '\.\[sam2\]'"):
        Sam2Video(folder)


def test_other_weights_are_refused(tmp_path):
    random_model().config.save_pretrained(tmp_path)
    torch.save(random_model().state_dict(), tmp_path / "pytorch_model.bin")  # which could hold code
    with pytest.raises(InputError, match="cannot be loaded"):
        Sam2Video(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"no weights in here")
    with pytest.raises(InputError, match="cannot be loaded"):
        Sam2Video(tmp_path)


def test_missing_weights_are_not_made_up(tmp_path):
    model = random_model()
    model.config.save_pretrained(tmp_path)
    weights = {name: value.contiguous() for name, value in model.state_dict().items() if "memory_encoder" not in name}
    safetensors_torch.save_file(weights, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(InputError, match=r"lacks \d+ of the weights of Sam2VideoModel"):
        Sam2Video(tmp_path)
