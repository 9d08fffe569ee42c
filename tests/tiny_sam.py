"""Models of the SAM family that are small enough to be written by a test, and whose masks can be foretold.

Each gives three masks: what its box holds, what its mask prompt says, and what is red in the picture. With these, a box
or a colour that arrives in the wrong place, order or scale shows in the mask that comes back.
"""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE, LOW = 128, 32
"""Sides of the square that pictures are scaled to, and of the masks that come back."""
SCORES = (0.5, 0.7, 0.6)
FAMILIES = ("sam2", "sam")
RED = 2.0
"""Normalised red above this, and green below its negative half, make a pixel red."""


def save_tiny_sam(folder: Path, family: str, scores: tuple[float, ...] = SCORES) -> Path:
    """A folder with an encoder and a decoder, named as that family's exports are."""
    folder.mkdir(parents=True, exist_ok=True)
    onnx.save(encoder(family), folder / "encoder.onnx")
    onnx.save(decoder(family, scores), folder / "decoder.onnx")
    return folder


def embeddings(family: str) -> dict[str, tuple[int, ...]]:
    """Names and shapes of what the encoder gives."""
    small, low = (1, 3, LOW // 2, LOW // 2), (1, 3, LOW, LOW)
    if family == "sam2":
        return {"high_res_feats_0": low, "high_res_feats_1": low, "image_embed": small}
    return {"image_embeddings": low}


def encoder(family: str, side: int | str = SIDE) -> onnx.ModelProto:
    """Pools the picture, so that an embedding is a small picture."""
    image = "images" if family == "sam" else "image"
    nodes = [helper.make_node("AveragePool", [image], ["pooled"], kernel_shape=[4, 4], strides=[4, 4])]
    for name, shape in embeddings(family).items():
        if shape[-1] == LOW:
            nodes.append(helper.make_node("Identity", ["pooled"], [name]))
        else:
            nodes.append(helper.make_node("AveragePool", ["pooled"], [name], kernel_shape=[2, 2], strides=[2, 2]))
    inputs = [_floats(image, (1, 3, side, side))]
    return _model(nodes, inputs, [_floats(*item) for item in embeddings(family).items()])


def decoder(family: str, scores: tuple[float, ...] = SCORES) -> onnx.ModelProto:
    """Draws the three masks."""
    features = list(embeddings(family))
    inputs = [_floats(*item) for item in embeddings(family).items()]
    constants = {"scores": np.array([scores], np.float32), "one": np.ones(1, np.float32)}
    inputs += [_floats("point_coords", (1, "points", 2)), _floats("point_labels", (1, "points"))]
    inputs += [_floats("mask_input", (1, 1, LOW, LOW)), _floats("has_mask_input", (1,))]
    inputs += [_floats("orig_im_size", (2,))] if family == "sam" else []
    nodes = [
        *_box_mask(constants),
        _node("Mul", ["mask_input", "has_mask_input"], "given"),
        _node("Sub", ["has_mask_input", "one"], "missing"),
        _node("Add", ["given", "missing"], "prompted"),
    ]
    nodes += _red_mask(features[0], constants)
    nodes += [_node("Concat", ["inside_box", "prompted", "red"], "three", axis=1)]
    low = "low_res_masks" if family == "sam" else "masks"
    nodes += [_node("Identity", ["three"], low), _node("Identity", ["scores"], "iou_predictions")]
    outputs = [_floats(low, (1, 3, LOW, LOW)), _floats("iou_predictions", (1, 3))]
    return _model(nodes, inputs, outputs, constants)


def _box_mask(constants: dict[str, np.ndarray]) -> list[onnx.NodeProto]:
    """One inside the box, and minus one elsewhere; coordinates count pixel centres."""
    centres = ((np.arange(LOW) + 0.5) * SIDE / LOW - 0.5).astype(np.float32)
    constants |= {
        "x": centres.reshape(1, 1, 1, LOW), "y": centres.reshape(1, 1, LOW, 1), "flat": np.array([-1], np.int64),
        "low_x": np.array([0]), "low_y": np.array([1]), "high_x": np.array([2]), "high_y": np.array([3]),
        "two": np.full(1, 2, np.float32), "half": np.full(1, 0.5, np.float32),
    }  # fmt: skip
    nodes = [_node("Reshape", ["point_coords", "flat"], "corners")]
    nodes += [_node("Gather", ["corners", name], f"{name}_at") for name in ("low_x", "low_y", "high_x", "high_y")]
    for name, compare, axis in (
        ("low_x", "Less", "x"), ("low_y", "Less", "y"), ("high_x", "Greater", "x"), ("high_y", "Greater", "y")
    ):  # fmt: skip
        nodes += [
            _node(compare, [axis, f"{name}_at"], f"{name}_beyond"),
            _node("Not", [f"{name}_beyond"], f"{name}_within"),
        ]
    nodes += [
        _node("And", ["low_x_within", "low_y_within"], "low_within"),
        _node("And", ["high_x_within", "high_y_within"], "high_within"),
        _node("And", ["low_within", "high_within"], "within"),
        helper.make_node("Cast", ["within"], ["within_float"], to=TensorProto.FLOAT),
        _node("Sub", ["within_float", "half"], "around_zero"),
        _node("Mul", ["around_zero", "two"], "inside_box"),
    ]
    return nodes


def _red_mask(feature: str, constants: dict[str, np.ndarray]) -> list[onnx.NodeProto]:
    constants |= {
        "channel_red": np.array([0]), "channel_green": np.array([1]), "weight": np.full(1, 1.0, np.float32),
        "red_limit": np.full(1, RED, np.float32),
    }  # fmt: skip
    return [
        _node("Gather", [feature, "channel_red"], "reds", axis=1),
        _node("Gather", [feature, "channel_green"], "greens", axis=1),
        _node("Sub", ["reds", "greens"], "redness"),
        _node("Sub", ["redness", "red_limit"], "red"),
    ]


def _node(kind: str, inputs: list[str], output: str, **attributes: int) -> onnx.NodeProto:
    return helper.make_node(kind, inputs, [output], **attributes)


def _floats(name: str, shape: tuple[int | str, ...]) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))


def _model(
    nodes: list[onnx.NodeProto],
    inputs: list[onnx.ValueInfoProto],
    outputs: list[onnx.ValueInfoProto],
    constants: dict[str, np.ndarray] | None = None,
) -> onnx.ModelProto:
    held = [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()]
    graph = helper.make_graph(nodes, "tiny", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    return model
