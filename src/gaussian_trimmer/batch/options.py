"""The settings of an item as text: the options that `gaussian-trimmer trim` has."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass, make_dataclass, replace
from functools import cache, lru_cache
from typing import Annotated, Any, Literal

from tyro.conf import arg

from gaussian_trimmer.config import TrimConfig, with_paper_preset
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.rendering import DEFAULT_RENDERER
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, all_options, options_of
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import hints_of

_SegmenterOptions = all_options()
_NOT_SAID = re.compile(r"[\u2500-\u257f]+|-{3,}|Parsing error|For full helptext.*")
"""The frames and the advice around what the parser says is wrong."""
_NAMES = {"config": "", "segmenter_options": "", "selection_options": "selection"}
"""Fields of `ItemOptions` that the command line names otherwise."""


@dataclass(frozen=True)
class ItemOptions:
    """The options of `gaussian-trimmer trim` that concern a trim itself, and not where its files are."""

    trust_paths: bool = False
    format: str | None = None
    preset: Literal["default", "paper"] = "default"
    views: int | None = None
    segmenter: str = DEFAULT_SEGMENTER
    renderer: str = DEFAULT_RENDERER
    config: TrimConfig = field(default_factory=TrimConfig)
    selection_options: SelectionOptions = field(default_factory=SelectionOptions)
    segmenter_options: Any = field(default_factory=_SegmenterOptions)

    def trim_config(self) -> TrimConfig:
        """The settings of all stages."""
        if self.views is None:
            return self.config
        return replace(self.config, plan=replace(self.config.plan, views=self.views))

    def used_options(self) -> Any:
        """The options of the segmenter that is used, or None if it has none."""
        return options_of(self.segmenter, self.segmenter_options)


@dataclass(frozen=True)
class _Option:
    """One option of the command line."""

    path: tuple[str, ...]
    """Names of the fields that lead to it from `ItemOptions`."""
    name: str
    """What it is called on the command line, without the dashes."""
    kind: Any
    default: Any


@lru_cache(maxsize=1024)
def parse_options(words: tuple[str, ...]) -> ItemOptions:
    """The settings that options mean.

    Raises:
        InputError: there is no such option, or its value is not possible.
    """
    options = ItemOptions()
    if not words:
        return options
    given = _parse(words)
    if given.get(("preset",)) == "paper":
        options = with_paper_preset(options)  # What is given beside it is set afterwards, so that it counts.
    for path, value in given.items():
        options = _with(options, path, value)
    return options


def _parse(words: tuple[str, ...]) -> dict[tuple[str, ...], Any]:
    """The values that are given, by their options' paths."""
    import tyro

    used = frozenset(word.partition("=")[0].replace("_", "-") for word in words if word.startswith("--"))
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            parsed = tyro.cli(_dataclass_of(used), args=words)
    except SystemExit:
        reason = " ".join(_NOT_SAID.sub(" ", said.getvalue()).split())
        raise InputError(
            f"The options '{shown(' '.join(words))}' are not understood ({shown(reason)}); 'gaussian-trimmer trim "
            "--help' lists them."
        ) from None
    return {option.path: getattr(parsed, "__".join(option.path)) for option in _used_options(used)}


@lru_cache(maxsize=256)
def _dataclass_of(used: frozenset[str]) -> type[Any]:
    """A dataclass with a field for each option that is used.

    A parser for all options takes a hundred times as long, and each row of a long manifest may have its own values.
    """
    fields: list[tuple[str, Any, Any]] = [
        ("__".join(option.path), Annotated[option.kind, arg(name=option.name)], field(default=option.default))
        for option in _used_options(used)
    ]
    return make_dataclass("UsedOptions", fields, frozen=True)


def _used_options(used: frozenset[str]) -> list[_Option]:
    return [option for flags, option in _all_options() if used & flags]


@cache
def _all_options() -> tuple[tuple[frozenset[str], _Option], ...]:
    """Every option, with the flags that set it."""
    return tuple((_flags_of(option), option) for option in _options_in(ItemOptions(), (), ""))


def _flags_of(option: _Option) -> frozenset[str]:
    group, dot, last = option.name.rpartition(".")
    return frozenset([f"--{option.name}", f"--{group}{dot}no-{last}"])


def _options_in(settings: Any, path: tuple[str, ...], prefix: str) -> Iterator[_Option]:
    kind: type = type(settings)
    hints = hints_of(kind)
    for name, value in vars(settings).items():
        called = _NAMES.get(name, name) if not path else name
        full = ".".join(filter(None, (prefix, called.replace("_", "-"))))
        if is_dataclass(value) and not isinstance(value, type):
            yield from _options_in(value, (*path, name), full)
        else:
            yield _Option((*path, name), full, hints[name], value)


def _with(settings: Any, path: tuple[str, ...], value: Any) -> Any:
    """Settings with another value for one of their fields, or for one of a dataclass within."""
    first, *rest = path
    return replace(settings, **{first: _with(getattr(settings, first), tuple(rest), value) if rest else value})
