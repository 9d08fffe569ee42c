"""The settings of the trimmer, for commands that trim and measure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from tyro.conf import arg

from gaussian_trimmer.config import TrimConfig, check_config
from gaussian_trimmer.evaluation.variants import Variant
from gaussian_trimmer.segmentation.segmenters import (
    DEFAULT_SEGMENTER,
    SEGMENTERS,
    all_options,
    segmenter_with,
)
from gaussian_trimmer.settings import check_settings

_SegmenterOptions = all_options()


@dataclass(frozen=True)
class TrimmerOptions:
    """What `trim` understands as well, but for its files."""

    preset: Literal["default", "paper"] = "default"
    """Defaults of all settings below: those of this program, or those of the GaussianTrimmer paper."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """What segments the object in the views."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    segmenter_options: Annotated[Any, arg(name="", constructor=_SegmenterOptions)] = field(
        default_factory=_SegmenterOptions
    )

    def variant(self) -> Variant:
        """The trimmer with these settings.

        Raises:
            InputError: a setting is not possible, or the segmenter cannot be used.
        """
        check_config(self.config)
        check_settings(self.segmenter_options)
        return Variant(self.config, segmenter_with(self.segmenter, self.segmenter_options))
