"""A model of the SAM family as two ONNX files: one that encodes a picture, one that draws masks for prompts in it.

Two exports are understood, which differ in the names of their inputs and outputs:

- SAM 2 as exporters of the original code write it: the encoder gives `image_embed` and `high_res_feats_0` and `_1`; the
  decoder takes these with `point_coords`, `point_labels`, `mask_input` and `has_mask_input`. Pictures are stretched to
  the model's square.
- SAM and MobileSAM as the original code exports them: one `image_embeddings`, the same prompts, and `orig_im_size`.
  Pictures keep their proportions, with nothing below or to the right.

Boxes are two points with labels of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer.errors import InputError, first_line
from gaussian_trimmer.gaussians import Float64Array, FloatArray
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.views.view import Box

BOX_CORNERS = (2, 3)
"""Point labels by which models of the SAM family know a box's two corners."""
MASK_LOGITS = (20.0, -10.0)
"""Scale and offset that turn a mask of zeros and ones into the logits that such a model takes as a prompt."""
IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Mean and standard deviation of the colours that these models were trained on."""
_PROMPTS = ("point_coords", "point_labels", "mask_input", "has_mask_input")
_SIZE = "orig_im_size"
_MASKS = ("low_res_masks", "masks")
_USUAL_SIDE = 1024
"""Side in pixels of the square that pictures are scaled to, where an export leaves it open."""
_WHERE = "docs/sam.md says where models come from"


@dataclass(frozen=True, eq=False)
class Prompt:
    """What the model is told of the object. Pixels' centres are at +0.5."""

    box: Box
    """Pixels (x0, y0, x1, y1) around the object; x1 and y1 are exclusive."""
    logits: FloatArray | None = None
    """Where the object is expected: above zero on it, (H, W)."""

    def corners(self) -> Float64Array:
        """Return centres of the box's first and last pixel, (2, 2)."""
        x0, y0, x1, y1 = self.box
        return np.array([[x0 + 0.5, y0 + 0.5], [x1 - 0.5, y1 - 0.5]])


class OnnxSam:
    """Encoder and decoder of one model, loaded.

    Args:
        folder: holds the two files.

    Raises:
        InputError: ONNX Runtime is not installed, the folder does not hold one encoder and one decoder of the SAM
            family, or they cannot be loaded.
    """

    def __init__(self, folder: Path) -> None:
        self._runtime = _import_runtime()
        self._errors = _errors_of(self._runtime)
        self._encoder_path, self._decoder_path = _find_files(folder)
        self._encoder, self._decoder = (self._load(path) for path in (self._encoder_path, self._decoder_path))
        self._image = self._encoder.get_inputs()[0]
        self._inputs = {node.name: node for node in self._decoder.get_inputs()}
        outputs = [node.name for node in self._decoder.get_outputs()]
        self._masks = next((name for name in _MASKS if name in outputs), "")
        self._features = [name for name in self._inputs if name not in (*_PROMPTS, _SIZE)]
        self._check(outputs)
        self.is_sam2 = len(self._features) > 1
        side = self._image.shape[2]
        self.side = side if isinstance(side, int) else _USUAL_SIDE

    def propose(self, rgb: FloatArray, prompt: Prompt) -> FloatArray:
        """Return the masks that the model proposes for a prompt in a picture: logits above zero on it, (K, H, W).

        Args:
            rgb: the picture, (H, W, 3) in [0, 1]; values outside are clipped.
            prompt: what is known of the object.

        Raises:
            InputError: the model cannot be run on it, or gives something else than masks.
        """
        height, width = rgb.shape[:2]
        features = self._run(self._encoder, self._encoder_path, self._features, {self._image.name: self._pixels(rgb)})
        feeds = dict(zip(self._features, features, strict=True)) | self._prompt_feeds(width, height, prompt)
        (masks,) = self._run(self._decoder, self._decoder_path, [self._masks], feeds)
        masks = masks.reshape(-1, *masks.shape[-2:])
        if not masks.size or not np.isfinite(masks).all():
            raise InputError(
                f"The decoder '{self._decoder_path}' gives masks {masks.shape} that are not finite numbers; another "
                "export is needed."
            )
        return self._at_picture_size(masks, width, height)

    def _load(self, path: Path) -> Any:
        options = self._runtime.SessionOptions()
        options.log_severity_level = 4  # What goes wrong becomes an error of our own.
        # Threads that spin while they wait lose their time to whatever else runs on the machine.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        if path.suffix == ".ort":  # such files have been optimised, and doing it again makes some unusable
            options.graph_optimization_level = self._runtime.GraphOptimizationLevel.ORT_DISABLE_ALL
        try:
            return self._runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except self._errors as error:
            raise InputError(f"The model '{path}' cannot be loaded ({first_line(error)}); {_WHERE}.") from error

    def _run(self, session: Any, path: Path, names: Sequence[str], feeds: Mapping[str, FloatArray]) -> list[FloatArray]:
        try:
            return [np.asarray(found, np.float32) for found in session.run(list(names), dict(feeds))]
        except self._errors as error:
            raise InputError(f"The model '{path}' cannot be run ({first_line(error)}).") from error

    def _check(self, outputs: Sequence[str]) -> None:
        """Refuse an encoder and a decoder that are none, or are of two exports."""
        if len(self._encoder.get_inputs()) != 1 or len(self._image.shape) != 4:
            found = ", ".join(f"{node.name} {node.shape}" for node in self._encoder.get_inputs())
            raise InputError(f"'{self._encoder_path}' is not an encoder of a picture: it takes {found}.")
        if not self._masks or not self._features or not {*_PROMPTS} <= {*self._inputs}:
            raise InputError(
                f"'{self._decoder_path}' is not a decoder of the SAM family as the original code exports it: it takes "
                f"{', '.join(self._inputs)}, and gives {', '.join(outputs)}. {_WHERE[0].upper()}{_WHERE[1:]}."
            )
        given = [node.name for node in self._encoder.get_outputs()]
        if missing := [name for name in self._features if name not in given]:
            raise InputError(
                f"The decoder '{self._decoder_path}' needs '{missing[0]}', which the encoder '{self._encoder_path}' "
                f"does not give (it gives {', '.join(given)}); take both files from one export."
            )

    def _scale(self, width: int, height: int) -> Float64Array:
        """Return pixels of the model's square for each pixel of a picture, across and down, (2,)."""
        if self.is_sam2:
            return np.array([self.side / width, self.side / height])
        return np.full(2, self.side / max(width, height))

    def _pixels(self, rgb: FloatArray) -> FloatArray:
        """Return a picture as the encoder takes it, (1, 3, side, side)."""
        size = np.maximum(1, np.round(self._scale(rgb.shape[1], rgb.shape[0]) * rgb.shape[1::-1])).astype(int)
        way = cv2.INTER_AREA if size[0] < rgb.shape[1] else cv2.INTER_LINEAR
        image = cv2.resize(np.clip(rgb, 0, 1).astype(np.float32), size.tolist(), interpolation=way)
        mean, std = (np.asarray(values, np.float32) for values in IMAGENET)
        square = np.zeros((self.side, self.side, 3), np.float32)
        square[: size[1], : size[0]] = (np.asarray(image, np.float32) - mean) / std
        return np.ascontiguousarray(square.transpose(2, 0, 1)[None])

    def _prompt_feeds(self, width: int, height: int, prompt: Prompt) -> dict[str, FloatArray]:
        """Return a prompt as the decoder takes it: pixels of the model's square, counted by their centres."""
        fixed = self._inputs["mask_input"].shape[-1]
        side = int(fixed) if isinstance(fixed, int) else self.side // 4
        mask = np.zeros((side, side)) if prompt.logits is None else self._at_model_size(prompt.logits, side)
        values = {
            "point_coords": (prompt.corners() * self._scale(width, height) - 0.5)[None],
            "point_labels": np.array([BOX_CORNERS]),
            "mask_input": mask[None, None],
            "has_mask_input": np.array([float(prompt.logits is not None)]),
            _SIZE: np.array([height, width]),
        }
        return {name: value.astype(np.float32) for name, value in values.items() if name in self._inputs}

    def _at_model_size(self, logits: FloatArray, side: int) -> FloatArray:
        """Return logits of a picture (H, W) in the square of the mask prompt, (side, side)."""
        sx, sy = self._scale(logits.shape[1], logits.shape[0]) * side / self.side
        columns, rows = (np.arange(side) + 0.5) / sx - 0.5, (np.arange(side) + 0.5) / sy - 0.5
        blurred = cv2.blur(logits, (max(1, round(1 / sx)), max(1, round(1 / sy))))
        return _sampled(blurred.astype(np.float32), columns, rows)

    def _at_picture_size(self, masks: FloatArray, width: int, height: int) -> FloatArray:
        """Return logits (K, h, w) as they come from the decoder, at the picture's size, (K, H, W)."""
        scale = self._scale(width, height) * np.array([masks.shape[2], masks.shape[1]]) / self.side
        columns, rows = ((np.arange(n) + 0.5) * s - 0.5 for n, s in zip((width, height), scale, strict=True))
        return np.stack([_sampled(mask, columns, rows) for mask in masks])


def _find_files(folder: Path) -> tuple[Path, Path]:
    """Return encoder and decoder in a folder.

    Raises:
        InputError: the folder cannot be read, or does not have one of each.
    """
    try:
        files = [file for file in sorted(folder.iterdir()) if file.suffix in (".onnx", ".ort") and is_file(file)]
    except (OSError, ValueError) as error:
        raise InputError(f"The folder '{folder}' cannot be read ({first_line(error)}); {_WHERE}.") from error
    encoders = [file for file in files if "encoder" in file.name.lower()]
    decoders = [file for file in files if file not in encoders]  # the original export names them after checkpoints
    if not len(encoders) == len(decoders) == 1:
        raise InputError(
            f"The folder '{folder}' must hold two .onnx or .ort files, an encoder with that word in its name and a "
            f"decoder; it holds {', '.join(file.name for file in files) or 'none'}. {_WHERE[0].upper()}{_WHERE[1:]}."
        )
    return encoders[0], decoders[0]


def _sampled(image: FloatArray, columns: Float64Array, rows: Float64Array) -> FloatArray:
    """Return an image (h, w) at pixel coordinates, bilinear, with its border values continued, (R, C)."""
    x, y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    found = cv2.remap(np.ascontiguousarray(image), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)


def _import_runtime() -> Any:
    try:
        return import_module("onnxruntime")
    except ImportError as error:
        raise InputError(f"SAM needs ONNX Runtime ({error}); in the program's clone: pip install '.[sam]'.") from error


def _errors_of(runtime: Any) -> tuple[type[Exception], ...]:
    """Return what ONNX Runtime raises: classes of its own, which have no common one."""
    own = vars(import_module(f"{runtime.__name__}.capi.onnxruntime_pybind11_state")).values()
    kinds = [kind for kind in own if isinstance(kind, type) and issubclass(kind, Exception)]
    return (*kinds, RuntimeError, ValueError, TypeError, OSError, NotImplementedError)
