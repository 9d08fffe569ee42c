"""The settings of an item as text: the options that `gaussian-trimmer trim` has."""

from __future__ import annotations

import contextlib
import io
import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Any, Literal

from tyro.conf import arg

from gaussian_trimmer.config import TrimConfig, paper_config
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.rendering import DEFAULT_RENDERER
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, PAPER_SEGMENTER, all_options, options_of
from gaussian_trimmer.selection_files import SelectionOptions

_SegmenterOptions = all_options()
_FRAME = re.compile(r"[\u2500-\u257f]+")


@dataclass(frozen=True)
class ItemOptions:
    """The options of `gaussian-trimmer trim` that concern a trim itself, and not where its files are."""

    trust_paths: bool = False
    format: str | None = None
    preset: Literal["default", "paper"] = "default"
    views: int | None = None
    segmenter: str = DEFAULT_SEGMENTER
    renderer: str = DEFAULT_RENDERER
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    segmenter_options: Annotated[Any, arg(name="", constructor=_SegmenterOptions)] = field(
        default_factory=_SegmenterOptions
    )

    def trim_config(self) -> TrimConfig:
        """The settings of all stages."""
        if self.views is None:
            return self.config
        return replace(self.config, plan=replace(self.config.plan, views=self.views))

    def used_options(self) -> Any:
        """The options of the segmenter that is used, or None if it has none."""
        return options_of(self.segmenter, self.segmenter_options)


@lru_cache(maxsize=1024)
def parse_options(words: tuple[str, ...]) -> ItemOptions:
    """The settings that options mean.

    Raises:
        InputError: there is no such option, or its value is not possible.
    """
    if not words:
        return ItemOptions()
    options = _parse(words, ItemOptions())
    if options.preset == "paper":  # once more over the preset's values, so that what is set beside it counts
        options = _parse(words, replace(options, config=paper_config(), segmenter=PAPER_SEGMENTER))
    return options


def _parse(words: tuple[str, ...], default: ItemOptions) -> ItemOptions:
    import tyro

    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            return tyro.cli(ItemOptions, args=words, default=default)
    except SystemExit:
        reason = " ".join(_FRAME.sub(" ", said.getvalue()).split()).removeprefix("Parsing error ")
        raise InputError(
            f"The options '{shown(' '.join(words))}' are not understood ({shown(reason)}); 'gaussian-trimmer trim "
            "--help' lists them."
        ) from None
