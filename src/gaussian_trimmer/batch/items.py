"""Items of a batch: one object of one scene each, with all settings of its trim."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.masks import DEFAULT_SEGMENTER, SEGMENTERS, options_kind
from gaussian_trimmer.output.placing import PlacingOptions
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings
from gaussian_trimmer.trimming.config import TrimConfig

_PUNCTUATION = "._-+"
"""In names of folders."""


@dataclass(frozen=True)
class Item:
    """One object of one scene, and how it is trimmed."""

    scene: str
    """Splat file of the scene, or of the object alone; or the folder of a training."""
    selection: str | None = None
    """Which Gaussians roughly are the object; None: the file holds the object alone."""
    name: str = ""
    """Folder of the results below `items` in the output; made from the names of the files if empty."""
    cameras: str | None = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json."""
    level: int | None = None
    """Level of detail of a streamed SOG; None: the finest that memory allows to work on."""
    trust_paths: bool = False
    """Open pictures that a transforms.json names outside its folder, if it does not say their size."""
    format: str | None = None
    """File format of object and background; that of the scene if None."""
    background: bool = True
    """Write the scene without the object too. It is nearly as large as the scene, for every object; labels.npz says
    which of the scene's Gaussians are in it."""
    html: bool = False
    """Also write report.html."""
    placing: PlacingOptions = field(default_factory=PlacingOptions)
    """How files for other programs are placed; by default none are written."""
    config: TrimConfig = field(default_factory=TrimConfig)
    segmenter: str = DEFAULT_SEGMENTER
    segmenter_options: Any = None
    """The options of that segmenter, an instance of its dataclass; None: its defaults."""
    selection_options: SelectionOptions = field(default_factory=SelectionOptions)

    def __post_init__(self) -> None:
        for name in ("scene", "selection", "cameras"):
            if isinstance(value := getattr(self, name), Path):
                object.__setattr__(self, name, str(value))

    @property
    def suffix(self) -> str:
        """The ending of the splat files that are written.

        Raises:
            InputError: no format has that name, or the scene's folder holds no splat file.
        """
        return (
            formats.written_suffix(identify(Path(self.scene)).scene) if self.format is None else suffix_of(self.format)
        )


def check_items(items: Iterable[Item]) -> list[Item]:
    """The items with their names, after all checks that need no file to be opened.

    Raises:
        InputError: there is no item, a setting is not possible, two items have the same name, the folder of one would
            lie in that of another, or one is a whole scene of which another is a part.
    """
    checked: list[Item] = []
    known: set[int] = set()
    for number, item in enumerate(items, 1):
        try:
            _check_settings(item, known)
            checked.append(replace(item, name=_checked_name(item.name)) if item.name else item)
        except InputError as error:
            raise InputError(f"Item {number}: {error}") from error
    if not checked:
        raise InputError("The batch has no items.")
    checked = _named(checked)
    numbers: dict[str, int] = {}
    for number, item in enumerate(checked, 1):
        if (first := numbers.setdefault(item.name.casefold(), number)) != number:  # some file systems fold cases
            raise InputError(
                f"Items {first} and {number} are both named '{clip_name(item.name)}'; give each a name of its own."
            )
    selected = {item.scene: item.name for item in checked if item.selection is not None}
    for number, item in enumerate(checked, 1):
        if item.selection is None and item.scene in selected:
            raise InputError(
                f"Item {number}, '{clip_name(item.name)}', has no selection, while '{selected[item.scene]}' has one in "
                "the same scene; say what it is, or leave the item out."
            )
    for name, number in numbers.items():
        for parent in map(str, PurePosixPath(name).parents):
            if parent in numbers:
                raise InputError(
                    f"The folder of item {number}, '{clip_name(name)}', would lie in that of item {numbers[parent]}; "
                    "give "
                    "it another name."
                )
    return checked


def default_name(item: Item) -> str:
    """A name made from the scene's path, the parts of the selection's that differ from it, and the object's ids.

    >>> default_name(Item("rooms/a/scene.ply", "rooms/a/coarse/mug.npy"))
    'rooms/a/scene/coarse-mug'
    >>> default_name(Item("b/a.ply", "b/ids.npy", selection_options=SelectionOptions("labels", (7,))))
    'b/a/ids-7'
    """
    scene = _safe_parts(item.scene)
    own = _safe_parts(item.selection) if item.selection else ["object"]
    common = 0
    while common < min(len(scene), len(own) - 1) and scene[common] == own[common]:
        common += 1
    ids = [str(i) for i in item.selection_options.object_id]
    return "/".join([*scene, "-".join([*own[common:], *ids])])


def has_whole_path(item: Item) -> bool:
    """Return whether an item's scene or selection is given from the root of the file system on."""
    return any(path is not None and Path(path).is_absolute() for path in (item.scene, item.selection))


def _named(items: Sequence[Item]) -> list[Item]:
    """Return items with names; whole paths give as many last parts of their default names as tell all of them apart.

    >>> [item.name for item in _named([Item("/data/a/scene.ply", "/data/a/mug.npy"), Item("a.ply", "b.npy")])]
    ['mug', 'a/b']
    """
    names = {n: default_name(item).split("/") for n, item in enumerate(items) if not item.name}
    whole = {n: parts for n, parts in names.items() if has_whole_path(items[n])}
    different = len({tuple(parts) for parts in whole.values()})
    longest = max(map(len, whole.values()), default=0)
    kept = next(
        (k for k in range(1, longest) if len({tuple(parts[-k:]) for parts in whole.values()}) == different), longest
    )
    names |= {n: parts[-kept:] for n, parts in whole.items()}
    return [replace(item, name="/".join(names[n])) if n in names else item for n, item in enumerate(items)]


def _check_settings(item: Item, known: set[int]) -> None:
    """Refuse settings that are not possible; `known` are the ids of those that are, as many items share them."""
    if item.segmenter not in SEGMENTERS:
        raise InputError(f"Unknown segmenter '{item.segmenter}'; available: {', '.join(SEGMENTERS)}.")
    kind = options_kind(item.segmenter)
    if item.segmenter_options is not None:
        if kind is None or not isinstance(item.segmenter_options, kind):
            given = type(item.segmenter_options).__name__
            raise InputError(f"The segmenter '{item.segmenter}' takes no options of the type {given}.")
        check_settings(item.segmenter_options, item.segmenter)
    check_settings(item.placing)
    if id(item.selection_options) not in known:
        check_settings(item.selection_options, "selection")
    if id(item.config) not in known:
        check_settings(item.config)
    known |= {id(item.selection_options), id(item.config)}
    assert item.suffix


def _checked_name(name: str) -> str:
    parts = [part for part in name.split("/") if part not in ("", ".", "..")]
    possible = "/".join(safe_file_name(part, _PUNCTUATION) for part in parts or ["_"])
    if name != possible:
        raise InputError(
            f"The name '{clip_name(name)}' cannot name a folder on every system, as '{clip_name(possible)}' can."
        )
    return name


def _safe_parts(path: str) -> list[str]:
    """The parts of a path as names of folders, without its root and its ending."""
    parts = [part for part in path.replace("\\", "/").split("/") if part not in ("", ".", "..")]
    if parts:
        parts[-1] = parts[-1].split(".")[0] or parts[-1]
    return [safe_file_name(part, _PUNCTUATION) for part in parts] or ["_"]
