"""SAM2.1 large with random weights: it costs what the trained one costs, and its masks mean nothing."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.segmentation.segmenters.sam2_video import Sam2Config, Sam2Segmenter
from gaussian_trimmer.segmentation.segmenters.silhouette import SilhouetteSegmenter
from gaussian_trimmer.views import View

# Where SAM2.1's large model differs from the smallest, which is what Transformers makes if nothing is said.
_LARGE_BACKBONE = {
    "model_type": "sam2_hiera_det_model",
    "hidden_size": 144,
    "num_attention_heads": 2,
    "blocks_per_stage": [2, 6, 36, 4],
    "embed_dim_per_stage": [144, 288, 576, 1152],
    "num_attention_heads_per_stage": [2, 4, 8, 16],
    "window_size_per_stage": [8, 4, 16, 8],
    "global_attention_blocks": [23, 33, 43],
    "window_positional_embedding_background_size": [7, 7],
}
_LARGE_VISION = {
    "model_type": "sam2_vision_model",
    "backbone_config": _LARGE_BACKBONE,
    "backbone_channel_list": [1152, 576, 288, 144],
}


def save_large_model(folder: Path) -> None:
    """A folder that `--sam2.model` takes, with 224 million random weights, 0.9 GB."""
    torch, transformers = import_module("torch"), import_module("transformers")
    torch.manual_seed(0)
    transformers.Sam2VideoModel(transformers.Sam2VideoConfig(vision_config=_LARGE_VISION)).save_pretrained(folder)


class RandomSam2Segmenter:
    """Runs SAM2 and gives the default segmenter's masks, so that the stages after it have as much to do as ever."""

    name = "sam2 with random weights"

    def __init__(self, folder: Path) -> None:
        self._sam2, self._masks = Sam2Segmenter(Sam2Config(model=str(folder))), SilhouetteSegmenter()

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        self._sam2.segment(views)
        return self._masks.segment(views)
