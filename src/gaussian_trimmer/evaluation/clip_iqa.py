"""CLIP-IQA: how an object looks, judged by a CLIP model between two opposite prompts.

The score of a picture is the probability that CLIP gives to the first prompt of a pair. The whole view is shown, with
the object alone over black, and prompts have the form of the official code's "Good photo."; that code shows pictures of
any size to a CLIP of convolutions (RN50), which Transformers does not have, so here they are stretched to the model's
square.

The model runs without its image processor, which would need torchvision.

After "Exploring CLIP for Assessing the Look and Feel of Images" (Wang et al., AAAI 2023).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import FloatArray

PAIRS = {
    "clip_clear": ("clear boundary", "unclear boundary"),
    "clip_smooth": ("smooth boundary", "noisy boundary"),
    "clip_complete": ("complete object", "mutilated object"),
}
"""Metric -> the prompt that is wished for, and its opposite."""
_CLIP_MEAN, _CLIP_STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Mean and deviation of the colours that CLIP models are trained on."""


class ClipScorer:
    """Scores pictures of objects with one CLIP model, which is loaded once.

    Raises:
        InputError: PyTorch or Transformers is missing, or the model cannot be loaded.
    """

    def __init__(self, model: str) -> None:
        try:
            self._torch, transformers = import_module("torch"), import_module("transformers")
        except ImportError as error:
            needs = f"CLIP-IQA needs PyTorch and Transformers ({error}): pip install 'gaussian-trimmer[eval]'."
            raise InputError(needs) from error
        local = Path(model).is_dir()
        try:
            # Weights are read from safetensors alone: other files could hold code.
            self._model = transformers.CLIPModel.from_pretrained(model, use_safetensors=True, local_files_only=local)
            tokenizer = transformers.CLIPTokenizer.from_pretrained(model, local_files_only=local)
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            first_line = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise InputError(
                f"Cannot load the CLIP model '{model}' ({first_line}); give a folder with model.safetensors and the "
                "tokenizer's files, or a name on the Hugging Face hub."
            ) from error
        self._model.eval()
        self.name = clip_name(Path(model).name if local else model)
        """Name of the model, for tables."""
        self._side = int(self._model.config.vision_config.image_size)
        prompts = [f"{prompt.capitalize()}." for pair in PAIRS.values() for prompt in pair]
        self._prompts = tokenizer(prompts, padding=True, return_tensors="pt")

    def describe(self) -> str:
        """Return what the scores were made with, for tables."""
        return f"CLIP-IQA by {self.name}: whole view over black and prompts as published"

    def score(self, rgb: FloatArray, alpha: FloatArray, threshold: float) -> dict[str, float]:
        """Return the three scores of an object in percent; nothing if it is not in the picture.

        Args:
            rgb: the object over black, (H, W, 3).
            alpha: its opacity, (H, W).
            threshold: opacity above which a pixel belongs to it.
        """
        if not (alpha > threshold).any():
            return {}
        return dict(zip(PAIRS, (100 * self._probabilities(np.clip(rgb, 0, 1))).tolist(), strict=True))

    def _probabilities(self, picture: FloatArray) -> FloatArray:
        """Return the probability of the first prompt of each pair, (3,)."""
        torch, side = self._torch, self._side
        interpolation = cv2.INTER_AREA if picture.shape[0] > side else cv2.INTER_CUBIC
        resized = np.asarray(cv2.resize(picture, (side, side), interpolation=interpolation))
        pixels = (resized - np.array(_CLIP_MEAN, np.float32)) / np.array(_CLIP_STD, np.float32)
        with torch.inference_mode():
            logits = self._model(
                pixel_values=torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])), **self._prompts
            ).logits_per_image
            pairs = logits.float().reshape(len(PAIRS), 2).softmax(dim=-1)[:, 0]
        return np.asarray(pairs.numpy(), np.float32)
