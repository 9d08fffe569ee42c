"""CLIP-IQA: how an object looks, judged by a CLIP model between two opposite prompts.

The score of a picture is the probability that CLIP gives to the first prompt of a pair. It is taken in two ways:

- as published: the whole view, with the object alone over black, and prompts such as "Clear boundary.", in the form of
  the official code's "Good photo."; that code shows pictures of any size to a CLIP of convolutions (RN50), which
  Transformers does not have, so here they are stretched to the model's square
- over crops: of the object alone over white, the first two pairs along its contour, the third of all of it; prompts
  such as "A photo with a clear boundary."

The model runs without its image processor, which would need torchvision.

After "Exploring CLIP for Assessing the Look and Feel of Images" (Wang et al., AAAI 2023).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.views.view import Box, bounding_box

PAIRS = {
    "clip_clear": ("clear boundary", "unclear boundary"),
    "clip_smooth": ("smooth boundary", "noisy boundary"),
    "clip_complete": ("complete object", "mutilated object"),
}
"""Metric -> the prompt that is wished for, and its opposite."""
OVER_CROPS = "_crops"
"""What the names of the metrics over crops end with."""
_OF_BOUNDARY = ("clip_clear", "clip_smooth")
_LINK = {"clip_clear": "with", "clip_smooth": "with", "clip_complete": "of"}
"""Word between "a photo" and the prompt."""
CROPS = 8
"""Crops along the contour."""
_CROP_SHARE = 1 / 3
"""Side of a crop, as a share of the longer side of the object's box."""
_SMALLEST_CROP_PIXELS = 32
_BOX_MARGIN = 0.1
"""What is added to each side of the object's box, as a share of its longer side."""
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
        prompts += [f"A photo {_LINK[name]} a {prompt}." for name, pair in PAIRS.items() for prompt in pair]
        self._prompts = tokenizer(prompts, padding=True, return_tensors="pt")

    def describe(self) -> str:
        """What the scores were made with, for tables."""
        crops = f"the object over white, boundaries over {CROPS} crops"
        return f"CLIP-IQA by {self.name}: whole view over black and prompts as published; over crops: {crops}"

    def score(self, rgb: FloatArray, alpha: FloatArray, threshold: float) -> dict[str, float]:
        """The three scores of an object in percent, in both ways; nothing if it is not in the picture.

        Args:
            rgb: the object over black, (H, W, 3).
            alpha: its opacity, (H, W).
            threshold: opacity above which a pixel belongs to it.
        """
        mask = np.asarray(alpha > threshold)
        if not mask.any():
            return {}
        picture = np.clip(rgb + (1 - np.clip(alpha, 0, 1))[..., None], 0, 1)
        boxes = [whole_box(mask), *boundary_boxes(mask)]
        chances = 100 * self._probabilities([np.clip(rgb, 0, 1), *(cut_square(picture, box) for box in boxes)])
        scores = {name: float(chances[0, i]) for i, name in enumerate(PAIRS)}
        for i, name in enumerate(PAIRS, len(PAIRS)):
            crops = chances[2:, i].mean() if name in _OF_BOUNDARY else chances[1, i]
            scores[name + OVER_CROPS] = float(crops)
        return scores

    def _probabilities(self, pictures: list[FloatArray]) -> FloatArray:
        """Probability of the first prompt of each pair, (P, 6): of the published form, then of the other."""
        torch = self._torch
        pixels = (
            np.stack([_resized(picture, self._side) for picture in pictures]) - np.array(_CLIP_MEAN, np.float32)
        ) / np.array(_CLIP_STD, np.float32)
        with torch.inference_mode():
            logits = self._model(
                pixel_values=torch.from_numpy(np.ascontiguousarray(pixels.transpose(0, 3, 1, 2))), **self._prompts
            ).logits_per_image
            pairs = logits.float().reshape(len(pictures), 2 * len(PAIRS), 2).softmax(dim=-1)[..., 0]
        return np.asarray(pairs.numpy(), np.float32)


def whole_box(mask: BoolArray) -> Box:
    """A square about a mask (H, W), a little wider; it may reach out of the picture."""
    x0, y0, x1, y1 = bounding_box(mask)
    side = round((1 + 2 * _BOX_MARGIN) * max(x1 - x0, y1 - y0))
    return _square((x0 + x1) // 2, (y0 + y1) // 2, max(side, _SMALLEST_CROP_PIXELS))


def boundary_boxes(mask: BoolArray) -> list[Box]:
    """`CROPS` squares of a third of the object's size, their centres evenly spread along its outer contours."""
    x0, y0, x1, y1 = bounding_box(mask)
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate([contour[:, 0] for contour in contours])
    side = max(round(_CROP_SHARE * max(x1 - x0, y1 - y0)), _SMALLEST_CROP_PIXELS)
    return [_square(int(x), int(y), side) for x, y in points[[i * len(points) // CROPS for i in range(CROPS)]]]


def cut_square(picture: FloatArray, box: Box) -> FloatArray:
    """What of a picture (H, W, 3) lies in a box, white outside of the picture."""
    (x0, y0, x1, y1), (height, width) = box, picture.shape[:2]
    padding = ((max(0, -y0), max(0, y1 - height)), (max(0, -x0), max(0, x1 - width)), (0, 0))
    return np.pad(picture[max(0, y0) : y1, max(0, x0) : x1], padding, constant_values=1).astype(np.float32)


def _square(x: int, y: int, side: int) -> Box:
    return x - side // 2, y - side // 2, x - side // 2 + side, y - side // 2 + side


def _resized(picture: FloatArray, side: int) -> FloatArray:
    interpolation = cv2.INTER_AREA if picture.shape[0] > side else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, (side, side), interpolation=interpolation))
