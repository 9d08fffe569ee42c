"""A model of the SAM family as two ONNX files: one that encodes a picture, one that draws masks for prompts in it.

Exports of these models differ in the names of their inputs and outputs. Three families are told apart by these alone:

- SAM 2 as exporters of the original code write it: the encoder gives `image_embed` and `high_res_feats_0` and `_1`; the
  decoder takes these with `point_coords`, `point_labels`, `mask_input` and `has_mask_input`.
- SAM and MobileSAM as the original code exports them: one `image_embeddings`, the same prompts, and `orig_im_size`.
- Either one as Transformers.js has them: `pixel_values` becomes `image_embeddings` and what belongs to them; prompts
  are `input_points`, `input_labels` and, for SAM 2, `input_boxes`.

Models with high-resolution features are SAM 2: pictures are stretched to its square. The others are SAM: pictures keep
their proportions, with nothing below or to the right. Boxes are two points with labels of their own where a decoder
has no input for boxes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray
from gaussian_trimmer.masks.onnx_model import (
    BOXES,
    HAS_MASK,
    LABELS,
    MASK,
    NUMBER_TYPES,
    POINTS,
    POSITIONAL,
    SIZE,
    WHERE,
    find_files,
    find_outputs,
    first_line,
    match_embeddings,
    only_input,
    side_of,
)
from gaussian_trimmer.masks.prompts import BACKGROUND, BOX_CORNERS, FOREGROUND, IMAGENET, Prompt

PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
    "directml": "DmlExecutionProvider",
    "cpu": "CPUExecutionProvider",
}
"""Names of what runs a model, best first, and what ONNX Runtime calls them."""
_MAX_BYTES = 8 << 30
_MAX_MASKS = 64


@dataclass(frozen=True, eq=False)
class Embedding:
    """What an encoder made of one picture."""

    tensors: Mapping[str, NDArray[Any]]
    """Inputs of the decoder by name."""
    width: int
    height: int
    """Size of the picture in pixels."""

    @property
    def n_bytes(self) -> int:
        """Memory that it takes."""
        return sum(tensor.nbytes for tensor in self.tensors.values())


@dataclass(frozen=True, eq=False)
class Candidates:
    """The masks that a decoder proposes for one prompt."""

    logits: FloatArray
    """Above zero on the object, (K, H, W)."""
    scores: FloatArray
    """The model's own estimate of each mask's intersection over union with the truth, (K,); ones if it gives none."""


class OnnxSam:
    """Encoder and decoder of one model, loaded.

    Args:
        folder: holds the two files, or has a folder `onnx` that does.
        provider: a key of `PROVIDERS`, or "auto" for the first that is there.

    Raises:
        InputError: ONNX Runtime is not installed or lacks the provider, the folder does not hold one encoder and one
            decoder of the SAM family, or they cannot be loaded.
    """

    def __init__(self, folder: Path, provider: str = "auto") -> None:
        self._runtime = _import_runtime()
        self._errors = _errors_of(self._runtime)
        self._providers = _find_providers(self._runtime, provider)
        encoder, decoder = find_files(folder)
        self._encoder, self._decoder = (self._load(path) for path in (encoder, decoder))
        used = self._encoder.get_providers()[0]
        if provider != "auto" and used != self._providers[0]:
            raise InputError(f"ONNX Runtime cannot start {self._providers[0]} here and would take {used}.")
        self.provider = next(name for name, full in PROVIDERS.items() if full == used)
        self._image = only_input(self._encoder, encoder)
        self._inputs = {node.name: node for node in self._decoder.get_inputs()}
        self._sources = match_embeddings(self._encoder, self._inputs, encoder, decoder)
        self._masks, self._scores = find_outputs(self._decoder, decoder)
        self.is_sam2 = len([name for name in self._sources if name != POSITIONAL]) > 1
        self.side = side_of(self._image, encoder)
        self.takes_mask = any(name in self._inputs for name in MASK)
        self.takes_box = any(name in self._inputs for name in BOXES) or POINTS[0] in self._inputs or self.is_sam2
        self._decoder_path, self._encoder_path = decoder, encoder

    @property
    def family(self) -> str:
        """Kind of model and of export, for reports."""
        kind = "SAM 2" if self.is_sam2 else "SAM"
        return f"{kind}, {'Transformers.js' if 'input_points' in self._inputs else 'original'} export"

    def encode(self, rgb: FloatArray) -> Embedding:
        """Return what the encoder makes of a picture (H, W, 3) in [0, 1]; values outside are clipped.

        Raises:
            InputError: the model cannot be run on it.
        """
        height, width = rgb.shape[:2]
        outputs = self._run(self._encoder, self._encoder_path, list(self._sources.values()), self._pixels(rgb))
        return Embedding(dict(zip(self._sources, outputs, strict=True)), width, height)

    def decode(self, embedding: Embedding, prompt: Prompt) -> Candidates:
        """Return the masks that the decoder proposes for a prompt in an encoded picture.

        Raises:
            InputError: the model cannot be run on it, or gives something else than masks.
        """
        feeds = {**embedding.tensors, **self._prompt_feeds(embedding, prompt)}
        names = [self._masks] + ([self._scores] if self._scores else [])
        outputs = self._run(self._decoder, self._decoder_path, names, feeds)
        masks = np.asarray(outputs[0], np.float32)
        n_masks = int(np.prod(masks.shape[:-2], dtype=np.int64)) if masks.ndim >= 3 else 0
        if not 1 <= n_masks <= _MAX_MASKS or 0 in masks.shape[-2:] or not np.isfinite(masks).all():
            raise InputError(
                f"The decoder '{self._decoder_path}' gives '{self._masks}' of shape {masks.shape}; up to {_MAX_MASKS} "
                "masks of finite numbers are needed."
            )
        masks = masks.reshape(n_masks, *masks.shape[-2:])
        scores = np.asarray(outputs[1], np.float32).ravel() if self._scores else np.ones(n_masks, np.float32)
        if len(scores) != n_masks:
            raise InputError(f"The decoder '{self._decoder_path}' gives {len(scores)} scores for {n_masks} masks.")
        return Candidates(self._at_picture_size(masks, embedding), np.nan_to_num(scores))

    def _load(self, path: Path) -> Any:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"The model '{path}' has {path.stat().st_size} bytes; more than {_MAX_BYTES} are refused.")
        options = self._runtime.SessionOptions()
        options.log_severity_level = 4  # What goes wrong becomes an error of our own.
        # Threads that spin while they wait lose their time to whatever else runs on the machine.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        if path.suffix == ".ort":  # such files have been optimised, and doing it again makes some unusable
            options.graph_optimization_level = self._runtime.GraphOptimizationLevel.ORT_DISABLE_ALL
        try:
            return self._runtime.InferenceSession(str(path), options, providers=self._providers)
        except self._errors as error:
            raise InputError(f"The model '{path}' cannot be loaded ({first_line(error)}); {WHERE}.") from error

    def _run(self, session: Any, path: Path, names: list[str], feeds: Mapping[str, NDArray[Any]]) -> list[Any]:
        try:
            return list(session.run(names, dict(feeds)))
        except self._errors as error:
            raise InputError(f"The model '{path}' cannot be run ({first_line(error)}).") from error

    def _scale(self, width: int, height: int) -> Float64Array:
        """Return pixels of the model's square for each pixel of a picture, across and down, (2,)."""
        if self.is_sam2:
            return np.array([self.side / width, self.side / height])
        return np.full(2, self.side / max(width, height))

    def _pixels(self, rgb: FloatArray) -> dict[str, NDArray[Any]]:
        """Return a picture as the encoder takes it."""
        size = np.maximum(1, np.round(self._scale(rgb.shape[1], rgb.shape[0]) * rgb.shape[1::-1])).astype(int)
        image = np.clip(rgb, 0, 1).astype(np.float32)
        shrinks = size[0] < rgb.shape[1]
        way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(image, size.tolist(), interpolation=way), np.float32)
        dtype = NUMBER_TYPES[self._image.type]
        if len(self._image.shape) == 3:  # such encoders normalise and fill up themselves
            fixed = [n if isinstance(n, int) else m for n, m in zip(self._image.shape, image.shape, strict=True)]
            whole = np.zeros(fixed, np.float32)
            whole[: size[1], : size[0]] = np.round(255 * image)
            return {self._image.name: whole.astype(dtype)}
        mean, std = (np.asarray(values, np.float32) for values in IMAGENET)
        square = np.zeros((self.side, self.side, 3), np.float32)
        square[: size[1], : size[0]] = (image - mean) / std
        return {self._image.name: np.ascontiguousarray(square.transpose(2, 0, 1)[None]).astype(dtype)}

    def _prompt_feeds(self, embedding: Embedding, prompt: Prompt) -> dict[str, NDArray[Any]]:
        """Return a prompt as the decoder takes it: pixels of the model's square, counted by their centres."""
        scale = self._scale(embedding.width, embedding.height)
        points, labels = prompt.points * scale - 0.5, np.where(prompt.inside, FOREGROUND, BACKGROUND)
        boxes = np.zeros((0, 4))
        if prompt.box is not None and self.takes_box:
            corners = prompt.corners() * scale - 0.5
            if any(name in self._inputs for name in BOXES):
                boxes = corners.reshape(1, 4)
            else:
                points, labels = np.concatenate([corners, points]), np.concatenate([BOX_CORNERS, labels])
        side = self._mask_side()
        given = prompt.logits is not None and self.takes_mask
        mask = self._at_model_size(prompt.logits, side) if given else np.zeros((side, side))
        transformers = "input_points" in self._inputs
        values = {
            POINTS: points[None, None] if transformers else points[None],
            LABELS: labels[None, None] if transformers else labels[None],
            BOXES: boxes[None],
            MASK: mask[None, None],
            HAS_MASK: np.array([float(given)]),
            SIZE: np.array([embedding.height, embedding.width]),
        }
        feeds = {name: value for names, value in values.items() for name in names if name in self._inputs}
        return {name: value.astype(NUMBER_TYPES[self._inputs[name].type]) for name, value in feeds.items()}

    def _mask_side(self) -> int:
        for name in MASK:
            if name in self._inputs and isinstance(self._inputs[name].shape[-1], int):
                return int(self._inputs[name].shape[-1])
        return self.side // 4

    def _at_model_size(self, logits: FloatArray | None, side: int) -> FloatArray:
        """Return logits of a picture (H, W) in the square of the mask prompt, (side, side)."""
        assert logits is not None
        sx, sy = self._scale(logits.shape[1], logits.shape[0]) * side / self.side
        columns, rows = (np.arange(side) + 0.5) / sx - 0.5, (np.arange(side) + 0.5) / sy - 0.5
        blurred = cv2.blur(logits, (max(1, round(1 / sx)), max(1, round(1 / sy))))
        return _sampled(blurred.astype(np.float32), columns, rows)

    def _at_picture_size(self, masks: FloatArray, embedding: Embedding) -> FloatArray:
        """Return logits (K, h, w) as they come from the decoder, at the picture's size, (K, H, W)."""
        width, height = embedding.width, embedding.height
        if any(name in self._inputs for name in SIZE) and masks.shape[1:] == (height, width):
            return masks
        scale = self._scale(width, height) * np.array([masks.shape[2], masks.shape[1]]) / self.side
        columns, rows = ((np.arange(n) + 0.5) * s - 0.5 for n, s in zip((width, height), scale, strict=True))
        return np.stack([_sampled(mask, columns, rows) for mask in masks])


def _sampled(image: FloatArray, columns: Float64Array, rows: Float64Array) -> FloatArray:
    """Return an image (h, w) at pixel coordinates, bilinear, with its border values continued, (R, C)."""
    x, y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    found = cv2.remap(np.ascontiguousarray(image), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)


def _import_runtime() -> Any:
    try:
        return import_module("onnxruntime")
    except ImportError as error:
        raise InputError(
            f'The segmenter sam needs ONNX Runtime ({error}); run: pip install "gaussian-trimmer[sam]".'
        ) from error


def _errors_of(runtime: Any) -> tuple[type[Exception], ...]:
    """Return what ONNX Runtime raises: classes of its own, which have no common one."""
    own = vars(import_module(f"{runtime.__name__}.capi.onnxruntime_pybind11_state")).values()
    kinds = [kind for kind in own if isinstance(kind, type) and issubclass(kind, Exception)]
    return (*kinds, RuntimeError, ValueError, TypeError, OSError, NotImplementedError)


def _find_providers(runtime: Any, name: str) -> list[str]:
    there = set(runtime.get_available_providers())
    if name == "auto":
        return [full for full in PROVIDERS.values() if full in there]
    if PROVIDERS[name] not in there:
        available = ", ".join(short for short, full in PROVIDERS.items() if full in there)
        raise InputError(
            f"The installed ONNX Runtime cannot run models on '{name}'; it has: {available}. Its packages "
            "onnxruntime-gpu (CUDA) and onnxruntime-directml (Windows) replace onnxruntime."
        )
    return list(dict.fromkeys([PROVIDERS[name], PROVIDERS["cpu"]]))
