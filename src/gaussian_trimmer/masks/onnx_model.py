"""Which files of a folder are a model of the SAM family, and which of their inputs and outputs are what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file

_MODEL_ENDINGS = (".onnx", ".ort")
_MAX_FILES = 64
"""Model files in a folder from which on it is not searched."""
_POSSIBLE_SIDES = range(32, 4097)
"""Sides of the square that pictures are scaled to, in pixels."""
_USUAL_SIDE = 1024
POINTS = ("point_coords", "input_points")
LABELS = ("point_labels", "input_labels")
BOXES = ("input_boxes",)
MASK = ("mask_input", "input_masks")
HAS_MASK = ("has_mask_input",)
SIZE = ("orig_im_size",)
_PROMPT_INPUTS = (*POINTS, *LABELS, *BOXES, *MASK, *HAS_MASK, *SIZE)
_MASK_OUTPUTS = ("low_res_masks", "pred_masks", "masks")
_SCORE_OUTPUTS = ("iou_predictions", "iou_scores")
POSITIONAL = "image_positional_embeddings"
NUMBER_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(uint8)": np.uint8,
}
WHERE = "docs/sam.md says where models come from"


def find_files(folder: Path) -> tuple[Path, Path]:
    """Return encoder and decoder in a folder, or in its folder `onnx`; their names tell which is which.

    Raises:
        InputError: the folder cannot be read, or does not have one of each.
    """
    try:
        places = [place for place in (folder, folder / "onnx") if place.is_dir()]
        listed = [file for place in places for file in sorted(place.iterdir()) if file.suffix in _MODEL_ENDINGS]
        files = [file for file in listed if is_file(file)]
    except (OSError, ValueError) as error:
        raise InputError(f"The folder '{folder}' cannot be read ({first_line(error)}).") from error
    if not places:
        raise InputError(f"There is no folder '{folder}' to load a SAM model from; {WHERE}.")
    if len(files) > _MAX_FILES:
        raise InputError(f"The folder '{folder}' has {len(files)} model files; put the two that are meant into one.")
    decoders = [file for file in files if "decoder" in file.name.lower()]
    encoders = [file for file in files if "encoder" in file.name.lower() and file not in decoders]
    rest = [file for file in files if file not in decoders and file not in encoders]
    if encoders and not decoders and len(rest) == 1:  # the original export script names decoders after checkpoints
        decoders = rest
    return _one_of(encoders, "encoder", folder), _one_of(decoders, "decoder", folder)


def _one_of(files: Sequence[Path], role: str, folder: Path) -> Path:
    if not files:
        raise InputError(
            f"The folder '{folder}' has no .onnx or .ort file with '{role}' in its name; a SAM model is an encoder "
            f"and a decoder. {WHERE[0].upper()}{WHERE[1:]}."
        )
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        raise InputError(f"The folder '{folder}' has several {role}s ({names}); leave one.")
    return files[0]


def only_input(encoder: Any, path: Path) -> Any:
    """Return the input of an encoder that takes the picture; InputError if it is none of a picture."""
    inputs = encoder.get_inputs()
    if len(inputs) != 1 or len(inputs[0].shape) not in (3, 4) or inputs[0].type not in NUMBER_TYPES:
        found = ", ".join(f"{node.name} {node.shape}" for node in inputs)
        raise InputError(f"'{path}' is not an encoder of a picture: it takes {found or 'nothing'}.")
    shape = inputs[0].shape
    channels = shape[2] if len(shape) == 3 else shape[1]
    if isinstance(channels, int) and channels != 3:
        raise InputError(f"'{path}' is not an encoder of colour pictures: its {inputs[0].name} has the shape {shape}.")
    return inputs[0]


def side_of(image: Any, path: Path) -> int:
    """Return the side of the square that an encoder's pictures are scaled to."""
    spatial = image.shape[2:] if len(image.shape) == 4 else image.shape[:2]
    known = {size for size in spatial if isinstance(size, int)}
    if len(known) > 1 or any(size not in _POSSIBLE_SIDES for size in known):
        raise InputError(
            f"The encoder '{path}' takes pictures of {' x '.join(map(str, spatial))} pixels; squares of "
            f"{_POSSIBLE_SIDES.start} to {_POSSIBLE_SIDES.stop - 1} are supported."
        )
    return known.pop() if known else _USUAL_SIDE


def match_embeddings(encoder: Any, inputs: Mapping[str, Any], encoder_path: Path, decoder_path: Path) -> dict[str, str]:
    """Return, for each input of the decoder that is no prompt, the output of the encoder that it takes."""
    if not (any(name in inputs for name in POINTS) and any(name in inputs for name in LABELS)):
        raise InputError(
            f"'{decoder_path}' is not a decoder of the SAM family: among its inputs {', '.join(inputs)} are no points "
            "and labels."
        )
    outputs = {node.name: node for node in encoder.get_outputs()}
    wanted = [name for name in inputs if name not in _PROMPT_INPUTS]
    sources = {name: name for name in wanted if name in outputs}
    for name in (name for name in wanted if name not in sources):
        free = [other for other in outputs if other not in sources.values()]
        alike = [other for other in free if list(outputs[other].shape) == list(inputs[name].shape)]
        if len(alike) != 1:
            raise InputError(
                f"The decoder '{decoder_path}' needs '{name}', which the encoder '{encoder_path}' does not give "
                f"(it gives {', '.join(outputs)}); take both files from one export."
            )
        sources[name] = alike[0]
    unknown = [node for node in inputs.values() if node.type not in NUMBER_TYPES]
    if unknown or not sources:
        what = f"its {unknown[0].name} is a {unknown[0].type}" if unknown else "it takes nothing from the encoder"
        raise InputError(f"'{decoder_path}' is not a decoder of the SAM family: {what}.")
    return sources


def find_outputs(decoder: Any, path: Path) -> tuple[str, str]:
    """Return the outputs with masks and with scores; the latter may be missing."""
    names = [node.name for node in decoder.get_outputs()]
    masks = next((name for name in _MASK_OUTPUTS if name in names), "")
    if not masks:
        raise InputError(f"'{path}' is not a decoder of the SAM family: it gives {', '.join(names)}, and no masks.")
    return masks, next((name for name in _SCORE_OUTPUTS if name in names), "")


def first_line(error: Exception) -> str:
    """Return what an error of ONNX Runtime says first."""
    return (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")[:300]
