"""Virtual view segmentation with SAM2, the segmenter of the GaussianTrimmer paper, through Hugging Face Transformers.

The models run without their processors, which need torchvision: pictures are resized and normalised here. Pictures,
prompts and logits stay on the model's device; only the finished masks come back.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.masks.prompts import BOX_CORNERS, IMAGENET, MASK_LOGITS, Prompt
from gaussian_trimmer.settings import check_settings
from gaussian_trimmer.views.view import View

Tensor = Any  # torch is imported late, so its types have no name here.
Colour = tuple[float, float, float]

_GPU_MODEL = "facebook/sam2.1-hiera-large"
_CPU_MODEL = "facebook/sam2.1-hiera-tiny"
_HUB_NAME = re.compile(r"[\w.-]+/[\w.-]+")
_OLDEST_TRANSFORMERS = (5, 6)  # 5.0 breaks off while tracking; versions before 5.6 cannot prompt SAM3 view by view.
_OBJECT_ID = 1
_MIN_VISIBLE_SHARE = 0.5


@dataclass(frozen=True)
class Sam2Config:
    """Which SAM2 model segments the virtual views, and how it is prompted."""

    model: str = ""
    """Model on the Hugging Face hub, or a local folder; if empty, SAM2.1 large on CUDA and tiny elsewhere."""
    prompting: Literal["video", "per-view"] = "video"
    """Prompt the first view and track the object through the others, or prompt every view for itself."""
    prompt: Literal["box", "mask"] = "box"
    """Prompt with the selected object's bounding box, or with its visible silhouette."""
    device: str = "auto"
    """Where the model runs: cuda, mps, cpu, or auto for the first of these that is there."""
    dtype: Literal["auto", "bfloat16", "float16", "float32"] = "auto"
    """Number format of the model; auto is bfloat16 on CUDA devices that compute in it, and float32 elsewhere."""


@dataclass(frozen=True)
class _Family:
    """The classes of Transformers that run one kind of checkpoint, and the colours that it was trained on."""

    video_class: str
    image_class: str
    mean: Colour
    std: Colour


_HALF_GREY: tuple[Colour, Colour] = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
# `model_type` of a checkpoint's config.json -> its family. All share SAM2's interface of sessions and prompts.
_FAMILIES = {
    "sam2_video": _Family("Sam2VideoModel", "Sam2Model", *IMAGENET),
    "edgetam_video": _Family("EdgeTamVideoModel", "EdgeTamModel", *IMAGENET),
    "sam3_video": _Family("Sam3TrackerVideoModel", "Sam3TrackerModel", *_HALF_GREY),
    "sam3_tracker_video": _Family("Sam3TrackerVideoModel", "Sam3TrackerModel", *_HALF_GREY),
}


class Sam2Segmenter:
    """Fulfils the `Segmenter` contract with a SAM2 model, or with an EdgeTAM or SAM3 tracker of the same interface.

    The model is loaded once, when the segmenter is made.

    Raises:
        InputError: a package that the model needs is missing, the device is not there, or the model cannot be loaded.
    """

    name = "sam2"

    def __init__(self, config: Sam2Config | None = None) -> None:
        self.config = config or Sam2Config()
        check_settings(self.config, self.name)
        self._torch, transformers = _import_libraries()
        self._device = _find_device(self._torch, self.config.device)
        self._dtype = _find_dtype(self._torch, self.config.dtype, self._device)
        self._source = self.config.model or (_GPU_MODEL if self._device.type == "cuda" else _CPU_MODEL)
        _check_source(self._source)
        self._model_type, self._family = _find_family(transformers, self._source)
        video = self.config.prompting == "video"
        class_name = self._family.video_class if video else self._family.image_class
        self.model = _load_model(transformers, class_name, self._source, self._dtype).to(self._device)
        self._side = int(self.model.config.prompt_encoder_config.image_size)

    def describe(self) -> str:
        """Return one line for reports: model, prompting, device and number format."""
        dtype = str(self._dtype).removeprefix("torch.")
        how = f"{self.config.prompting} prompting by {self.config.prompt}"
        return f"sam2 with {self._source} ({self._model_type}), {how}, on {self._device} in {dtype}"

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return one mask (H, W) for each view. Views are taken in order of yaw, as the frames of a video.

        A view without a prompt, because the selected object is not visible in it, gets an empty mask; so do all
        views of a video whose first view has none.

        Eq. 6 of GaussianTrimmer for the first view, and the tracking that follows it.
        """
        with self._torch.inference_mode():
            if self.config.prompting == "video":
                masks = self._segment_as_video(views)
            else:
                masks = [self._segment_by_itself(view) for view in views]
            return [mask.cpu().numpy() for mask in masks]

    def _segment_as_video(self, views: Sequence[View]) -> list[Tensor]:
        if not views or not self._has_prompt(views[0]):
            return [self._empty_mask(view) for view in views]
        by_mask = self.config.prompt == "mask"
        # SAM2 returns a given mask unchanged on its own frame. The first view therefore comes once more at the end
        # of the video, where it is segmented like the others.
        frames = [*views, views[0]] if by_mask else list(views)
        session = self._open_session(frames)
        index = session.obj_id_to_idx(_OBJECT_ID)
        if by_mask:
            session.add_mask_inputs(index, 0, self._silhouette(views[0]))
        else:
            labels = self._torch.tensor([[BOX_CORNERS]], dtype=self._torch.int32)
            session.add_point_inputs(index, 0, {"point_coords": self._corners(views[0]), "point_labels": labels})
        session.obj_with_new_inputs = [_OBJECT_ID]
        self.model(inference_session=session, frame_idx=0)
        logits = [output.pred_masks for output in self.model.propagate_in_video_iterator(session)]
        if by_mask:
            logits = [logits[-1], *logits[1:-1]]
        return [self._mask(frame, view) for frame, view in zip(logits, views, strict=True)]

    def _segment_by_itself(self, view: View) -> Tensor:
        if not self._has_prompt(view):
            return self._empty_mask(view)
        prompt = {"input_boxes": self._corners(view).reshape(1, 1, 4)}
        if self.config.prompt == "mask":
            scale, offset = MASK_LOGITS
            prompt["input_masks"] = (scale * self._silhouette(view) + offset).to(self._dtype)
        output = self.model(pixel_values=self._pixels(view)[None], multimask_output=False, **prompt)
        return self._mask(output.pred_masks[:, 0], view)

    def _open_session(self, frames: Sequence[View]) -> Any:
        module = import_module(type(self.model).__module__)
        session_class = getattr(module, type(self.model).__name__.replace("Model", "InferenceSession"))
        height, width = frames[0].rgb.shape[:2]
        return session_class(
            video=self._torch.stack([self._pixels(frame) for frame in frames]),
            video_height=height,
            video_width=width,
            inference_device=self._device,
            inference_state_device=self._device,
            video_storage_device=self._device,
            dtype=self._dtype,
        )

    def _has_prompt(self, view: View) -> bool:
        shown = view.object_alpha if self.config.prompt == "box" else view.object_visible
        return bool((shown > _MIN_VISIBLE_SHARE).any())

    def _pixels(self, view: View) -> Tensor:
        """Return the picture as the model wants it, stretched to a square and normalised, (3, S, S)."""
        rgb = self._torch.from_numpy(np.clip(view.rgb, 0.0, 1.0).astype(np.float32)).to(self._device)
        square = self._resized(rgb.permute(2, 0, 1)[None], (self._side, self._side))[0]
        mean, std = (square.new_tensor(colour)[:, None, None] for colour in (self._family.mean, self._family.std))
        return ((square - mean) / std).to(self._dtype)

    def _corners(self, view: View) -> Tensor:
        """Return centres of the box's upper left and lower right pixel in the model's square, (1, 1, 2, 2).

        The model counts pixels by their centres: its prompt encoder adds the half pixel that is taken off here.
        """
        height, width = view.rgb.shape[:2]
        centres = self._torch.tensor(Prompt(view.box).corners().tolist(), device=self._device)
        scale = centres.new_tensor([self._side / width, self._side / height])
        return (centres * scale - 0.5)[None, None]

    def _silhouette(self, view: View) -> Tensor:
        """Return where the selected object is visible, one or zero, in the model's square, (1, 1, S, S)."""
        visible = self._torch.from_numpy((view.object_visible > _MIN_VISIBLE_SHARE).astype(np.float32)).to(self._device)
        return (self._resized(visible[None, None], (self._side, self._side)) >= 0.5).float()

    def _mask(self, logits: Tensor, view: View) -> Tensor:
        """Return logits (1, 1, h, w) as a mask of the view's size, (H, W)."""
        return self._resized(logits.float(), view.rgb.shape[:2])[0, 0] > 0

    def _empty_mask(self, view: View) -> Tensor:
        return self._torch.zeros(view.rgb.shape[:2], dtype=self._torch.bool, device=self._device)

    def _resized(self, images: Tensor, size: tuple[int, ...]) -> Tensor:
        return self._torch.nn.functional.interpolate(
            images, size=size, mode="bilinear", align_corners=False, antialias=True
        )


def _import_libraries() -> tuple[Any, Any]:
    """Return the modules torch and transformers."""
    try:
        torch, transformers = import_module("torch"), import_module("transformers")
        version = metadata.version("transformers")
    except ImportError as error:
        raise InputError(
            f'SAM2 needs PyTorch and Transformers ({error}); run: pip install "gaussian-trimmer[sam2]".'
        ) from error
    if tuple(int(part) for part in version.split(".")[:2]) < _OLDEST_TRANSFORMERS:
        oldest = ".".join(map(str, _OLDEST_TRANSFORMERS))
        raise InputError(
            f"SAM2 needs Transformers {oldest} or newer, and {version} is installed; "
            "run: pip install --upgrade transformers."
        )
    return torch, transformers


def _find_device(torch: Any, name: str) -> Any:
    present = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    if name == "auto":
        return torch.device(next(kind for kind, is_there in present.items() if is_there))
    kind = name.partition(":")[0]
    if not present.get(kind, False):
        available = ", ".join(kind for kind, is_there in present.items() if is_there)
        raise InputError(f"SAM2 cannot run on '{name}'; PyTorch has here: {available}.")
    return torch.device(name)


def _find_dtype(torch: Any, name: str, device: Any) -> Any:
    if name != "auto":
        return getattr(torch, name)
    fast = device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.bfloat16 if fast else torch.float32


def _check_source(source: str) -> None:
    """Raise an InputError for what is neither a folder nor of the form of a name on the hub."""
    if not Path(source).is_dir() and not _HUB_NAME.fullmatch(source):
        raise InputError(
            f"There is no folder '{source}' to load a SAM2 model from; --set sam2.model needs a folder that holds "
            "config.json and model.safetensors, or a name on the Hugging Face hub such as facebook/sam2.1-hiera-tiny."
        )


def _find_family(transformers: Any, source: str) -> tuple[str, _Family]:
    """Return the kind of a checkpoint, by its config.json."""
    try:
        configuration, _ = transformers.PreTrainedConfig.get_config_dict(source)
    except (OSError, ValueError) as error:
        raise InputError(_cannot_load(source, error)) from error
    kind = str(configuration.get("model_type", "none"))
    if kind not in _FAMILIES:
        raise InputError(f"The model '{source}' is of type '{kind}'; the sam2 segmenter runs {', '.join(_FAMILIES)}.")
    return kind, _FAMILIES[kind]


def _load_model(transformers: Any, class_name: str, source: str, dtype: Any) -> Any:
    """Return a checkpoint as a model in inference mode, from safetensors only: other weight files could hold code."""
    try:
        model_class = getattr(transformers, class_name)
    except AttributeError as error:
        raise InputError(
            f"The installed transformers {transformers.__version__} has no {class_name}; "
            "run: pip install --upgrade transformers."
        ) from error
    except ImportError as error:
        raise InputError(
            f"Transformers cannot import {class_name} ({error.__cause__ or error}); if the cause is a torchvision that "
            "was made for another PyTorch, install the one that matches, or none."
        ) from error
    try:
        model, report = model_class.from_pretrained(source, dtype=dtype, use_safetensors=True, output_loading_info=True)
    except ImportError as error:
        reason = str(error).strip().partition(". ")[0]
        raise InputError(f"The model '{source}' cannot be built: {reason}; install it and try again.") from error
    except (OSError, ValueError, RuntimeError, import_module("safetensors").SafetensorError) as error:
        raise InputError(_cannot_load(source, error)) from error
    if report["missing_keys"]:
        # Transformers would fill these with random numbers.
        missing = len(report["missing_keys"])
        raise InputError(f"The model '{source}' lacks {missing} of the weights of {class_name}; download it anew.")
    return model.eval()


def _cannot_load(source: str, error: Exception) -> str:
    reason = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
    return (
        f"The SAM2 model '{source}' cannot be loaded ({reason}); where the Hugging Face hub is out of reach, copy the "
        "model's config.json and model.safetensors into a folder and give --set sam2.model=FOLDER."
    )
