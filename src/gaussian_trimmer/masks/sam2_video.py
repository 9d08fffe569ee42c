"""SAM 2 as the GaussianTrimmer paper uses it, by Hugging Face Transformers: it follows the object through the views.

The model runs without its processor, which needs torchvision: pictures are resized and normalised here. Pictures,
prompts and logits stay on the model's device; only the finished masks come back.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError, first_line
from gaussian_trimmer.gaussians import FloatArray
from gaussian_trimmer.masks.sam_onnx import BOX_CORNERS, IMAGENET, Prompt
from gaussian_trimmer.views.view import HALF, View

Tensor = Any  # torch is imported late, so its types have no name here.

_OLDEST_TRANSFORMERS = (5, 6)  # 5.0 breaks off while tracking.
_MODEL_TYPE = "sam2_video"
_OBJECT_ID = 1


class Sam2Video:
    """A SAM 2 model, loaded to CUDA or Metal where these are there.

    Args:
        folder: holds config.json and model.safetensors.

    Raises:
        InputError: a package that the model needs is missing, or the model cannot be loaded.
    """

    def __init__(self, folder: Path) -> None:
        self._torch, transformers = _import_libraries()
        cuda, metal = self._torch.cuda.is_available(), self._torch.backends.mps.is_available()
        self._device = self._torch.device("cuda" if cuda else "mps" if metal else "cpu")
        fast = cuda and self._torch.cuda.is_bf16_supported(including_emulation=False)
        self._dtype = self._torch.bfloat16 if fast else self._torch.float32
        self.model = _load_model(transformers, folder, self._dtype).to(self._device)
        self._side = int(self.model.config.prompt_encoder_config.image_size)

    def follow(self, views: Sequence[View]) -> list[FloatArray]:
        """Return the mask of each view as logits (H, W). Views are in order of yaw, as the frames of a video.

        The object's box in the first view is the prompt: eq. 6 of GaussianTrimmer. If it does not show there, no view
        has a mask.
        """
        if not views or not (views[0].object_alpha > HALF).any():
            return [np.full(view.alpha.shape, -1, np.float32) for view in views]
        with self._torch.inference_mode():
            session = self._open_session(views)
            labels = self._torch.tensor([[BOX_CORNERS]], dtype=self._torch.int32)
            prompt = {"point_coords": self._corners(views[0]), "point_labels": labels}
            session.add_point_inputs(session.obj_id_to_idx(_OBJECT_ID), 0, prompt)
            session.obj_with_new_inputs = [_OBJECT_ID]
            self.model(inference_session=session, frame_idx=0)
            found = [output.pred_masks for output in self.model.propagate_in_video_iterator(session)]
            pairs = zip(found, views, strict=True)
            return [self._resized(mask.float(), view.alpha.shape)[0, 0].cpu().numpy() for mask, view in pairs]

    def _open_session(self, views: Sequence[View]) -> Any:
        height, width = views[0].alpha.shape
        return import_module(type(self.model).__module__).Sam2VideoInferenceSession(
            video=self._torch.stack([self._pixels(view) for view in views]),
            video_height=height,
            video_width=width,
            inference_device=self._device,
            inference_state_device=self._device,
            video_storage_device=self._device,
            dtype=self._dtype,
        )

    def _pixels(self, view: View) -> Tensor:
        """Return the picture as the model wants it, stretched to a square and normalised, (3, S, S)."""
        rgb = self._torch.from_numpy(np.clip(view.rgb, 0.0, 1.0).astype(np.float32)).to(self._device)
        square = self._resized(rgb.permute(2, 0, 1)[None], (self._side, self._side))[0]
        mean, std = (square.new_tensor(colour)[:, None, None] for colour in IMAGENET)
        return ((square - mean) / std).to(self._dtype)

    def _corners(self, view: View) -> Tensor:
        """Return centres of the box's upper left and lower right pixel in the model's square, (1, 1, 2, 2).

        The model counts pixels by their centres: its prompt encoder adds the half pixel that is taken off here.
        """
        height, width = view.alpha.shape
        centres = self._torch.tensor(Prompt(view.box).corners().tolist(), device=self._device)
        scale = centres.new_tensor([self._side / width, self._side / height])
        return (centres * scale - 0.5)[None, None]

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
            f"SAM 2 needs PyTorch and Transformers ({error}); in the program's clone: pip install '.[sam2]'."
        ) from error
    if tuple(int(part) for part in version.split(".")[:2]) < _OLDEST_TRANSFORMERS:
        oldest = ".".join(map(str, _OLDEST_TRANSFORMERS))
        raise InputError(
            f"SAM 2 needs Transformers {oldest} or newer, and {version} is installed; "
            "run: pip install --upgrade transformers."
        )
    return torch, transformers


def _load_model(transformers: Any, folder: Path, dtype: Any) -> Any:
    """Return a checkpoint as a model in inference mode, from safetensors only: other weight files could hold code."""
    source = str(folder)
    try:
        configuration, _ = transformers.PreTrainedConfig.get_config_dict(source)
        kind = str(configuration.get("model_type", "none"))
        if kind != _MODEL_TYPE:
            raise InputError(f"The model '{source}' is of type '{kind}'; {_MODEL_TYPE} is needed.")
        options = {"dtype": dtype, "use_safetensors": True, "output_loading_info": True}
        model, report = transformers.Sam2VideoModel.from_pretrained(source, **options)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(
            f"Transformers cannot import Sam2VideoModel ({error.__cause__ or error}); if the cause is a torchvision "
            "that was made for another PyTorch, install the one that matches, or none."
        ) from error
    except (OSError, ValueError, RuntimeError, import_module("safetensors").SafetensorError) as error:
        raise InputError(
            f"The SAM 2 model '{source}' cannot be loaded ({first_line(error)}); the folder must hold the "
            "model's config.json and model.safetensors, as facebook/sam2.1-hiera-tiny has them."
        ) from error
    if report["missing_keys"]:
        # Transformers would fill these with random numbers.
        missing = len(report["missing_keys"])
        raise InputError(f"The model '{source}' lacks {missing} of the weights of Sam2VideoModel; download it anew.")
    return model.eval()
