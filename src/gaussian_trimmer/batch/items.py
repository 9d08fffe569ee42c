"""What a batch is made of: items, each one object of one scene with all settings of its trim."""

from __future__ import annotations

import types
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from gaussian_trimmer import formats
from gaussian_trimmer.config import TrimConfig, check_config
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, SEGMENTERS
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings, hints_of

_SAFE = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-+")
_LONGEST_PART = 150
Json = dict[str, Any]


@dataclass(frozen=True)
class Item:
    """One object of one scene, and how it is trimmed.

    Paths are those of files, or addresses that fsspec opens, such as s3://bucket/scene.ply.
    """

    scene: str
    """Splat file of the scene, or of the object alone."""
    selection: str | None = None
    """Which Gaussians roughly are the object; none: the file holds the object alone."""
    name: str = ""
    """Where the results go below the output folder, with slashes; made from the names of the files if not given."""
    cameras: str | None = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    format: str | None = None
    """File format of object and background; that of the scene if not given."""
    background: bool = True
    """Write the scene without the object too. It is nearly as large as the scene, for every object; labels.npz says
    which of the scene's Gaussians are in it."""
    config: TrimConfig = field(default_factory=TrimConfig)
    segmenter: str = DEFAULT_SEGMENTER
    segmenter_options: Any = None
    """The options of that segmenter, an instance of its dataclass; None: its defaults."""
    renderer: str = DEFAULT_RENDERER
    selection_options: SelectionOptions = field(default_factory=SelectionOptions)

    def __post_init__(self) -> None:
        for name in ("scene", "selection", "cameras"):
            if isinstance(value := getattr(self, name), Path):
                object.__setattr__(self, name, str(value))

    @property
    def suffix(self) -> str:
        """The ending of the splat files that are written.

        Raises:
            InputError: no format has that name.
        """
        return formats.written_suffix(self.scene) if self.format is None else suffix_of(self.format)


def check_items(items: Iterable[Item]) -> list[Item]:
    """The items with names, after a look at everything that can be checked without opening a file.

    Raises:
        InputError: there is no item, a setting is not possible, or two items have the same name, or one's folder would
            lie in another's.
    """
    given, known = list(items), set[int]()
    checked = [_check_item(item, number, known) for number, item in enumerate(given, 1)]
    if not checked:
        raise InputError("The batch has no items.")
    numbers: dict[str, int] = {}
    for number, item in enumerate(checked, 1):
        folded = item.name.casefold()  # for file systems that do not tell cases apart
        if folded in numbers:
            raise InputError(
                f"Items {numbers[folded]} and {number} are both named '{shown(item.name)}'; give each a name of its "
                "own."
            )
        numbers[folded] = number
    for folded, number in numbers.items():
        for parent in PurePosixPath(folded).parents:
            if str(parent) in numbers:
                raise InputError(
                    f"The folder of item {number}, '{shown(folded)}', would lie in that of item "
                    f"{numbers[str(parent)]}; give it another name."
                )
    return checked


def default_name(item: Item) -> str:
    """A name made from the scene's path and, of the selection's, what differs from it, and the ids of the object.

    >>> default_name(Item("rooms/a/scene.ply", "rooms/a/coarse/mug.npy"))
    'rooms/a/scene/coarse-mug'
    >>> default_name(Item("s3://b/a.ply", "s3://b/ids.npy", selection_options=SelectionOptions("labels", (7,))))
    'b/a/ids-7'
    """
    scene = _parts(item.scene)
    own = _parts(item.selection) if item.selection else ["object"]
    common = 0
    while common < min(len(scene), len(own) - 1) and scene[common] == own[common]:
        common += 1
    ids = [str(i) for i in item.selection_options.object_id]
    return "/".join([*scene, "-".join([*own[common:], *ids])])


def item_as_json(item: Item, known: dict[int, tuple[Any, Any]] | None = None) -> Json:
    """An item as JSON holds it.

    Args:
        known: what settings became earlier, by their identity: items by the thousand have the same ones.
    """
    known = {} if known is None else known
    data: Json = {}
    for entry in fields(item):
        value = getattr(item, entry.name)
        if not is_dataclass(value):
            data[entry.name] = value
            continue
        if id(value) not in known:
            known[id(value)] = value, _plain(asdict(value))  # type: ignore[arg-type]
        data[entry.name] = known[id(value)][1]
    return data


def item_of_json(data: Json) -> Item:
    """The item that `item_as_json` was given."""
    options, kind = data["segmenter_options"], options_kind(data["segmenter"])
    made = {
        name: _typed(value, hint)
        for (name, hint), value in ((pair, data[pair[0]]) for pair in hints_of(Item).items())
        if name != "segmenter_options"
    }
    return Item(**made, segmenter_options=_typed(options, kind) if options is not None and kind else None)


def options_kind(segmenter: str) -> type[Any] | None:
    """The dataclass of a segmenter's options, or None if it has none."""
    module, _, kind = SEGMENTERS[segmenter]
    return getattr(import_module(module), kind) if kind else None


def _check_item(item: Any, number: int, known: set[int]) -> Item:
    if not isinstance(item, Item):
        raise InputError(f"Item {number} is a {type(item).__name__}; give batch.Item.")
    try:
        _check_settings(item, known)
        return replace(item, name=_checked_name(item.name) if item.name else default_name(item))
    except InputError as error:
        raise InputError(f"Item {number}: {error}") from error


def _check_settings(item: Item, known: set[int]) -> None:
    """Check what an item says; `known` are the identities of settings that were found to be possible."""
    if item.segmenter not in SEGMENTERS:
        raise InputError(f"Unknown segmenter '{item.segmenter}'; available: {', '.join(SEGMENTERS)}.")
    if item.renderer not in RENDERER_CHOICES:
        raise InputError(f"Unknown renderer '{item.renderer}'; available: {', '.join(RENDERER_CHOICES)}.")
    kind = options_kind(item.segmenter)
    if item.segmenter_options is not None:
        if kind is None or not isinstance(item.segmenter_options, kind):
            raise InputError(
                f"The options of the segmenter '{item.segmenter}' are a {type(item.segmenter_options).__name__}; give "
                + (f"a {kind.__name__}." if kind else "none.")
            )
        check_settings(item.segmenter_options, item.segmenter)
    if id(item.selection_options) not in known:
        check_settings(item.selection_options, "selection")
    if id(item.config) not in known:
        check_config(item.config)
    known |= {id(item.selection_options), id(item.config)}
    assert item.suffix


def _checked_name(name: str) -> str:
    parts = name.split("/")
    if all(_is_safe(part) for part in parts):
        return name
    raise InputError(
        f"The name '{shown(name)}' cannot be that of a folder everywhere; letters, digits and . _ - + can be used, "
        "and slashes between folders."
    )


def _is_safe(part: str) -> bool:
    return 0 < len(part) <= _LONGEST_PART and set(part) <= _SAFE and part[0] not in ".-" and part[-1] != "."


def _parts(path: str) -> list[str]:
    """The safe parts of a path, without its root, its scheme and its ending."""
    parts = [part for part in path.split("://")[-1].replace("\\", "/").split("/") if part not in ("", ".", "..")]
    if parts:
        parts[-1] = parts[-1].split(".")[0] or parts[-1]
    cleaned = ("".join(c if c in _SAFE else "_" for c in part).lstrip(".-").rstrip(".") for part in parts)
    return [part[:_LONGEST_PART] or "_" for part in cleaned] or ["_"]


def _plain(value: Any) -> Any:
    """A value of settings as JSON holds it."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


def _typed(value: Any, kind: Any) -> Any:
    """A value of the kind that a field of settings has, from what JSON holds."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _typed(value, arguments[0])
    if origin in (Union, types.UnionType):
        meant = [argument for argument in arguments if argument is not type(None)]
        return None if value is None else _typed(value, meant[0])
    if value is None or origin is Literal:
        return value
    if is_dataclass(kind):
        hints = hints_of(kind)  # type: ignore[arg-type]
        return kind(**{f.name: _typed(value[f.name], hints[f.name]) for f in fields(kind) if f.name in value})  # type: ignore[operator]
    if origin is tuple:
        return tuple(_typed(entry, arguments[0]) for entry in value)
    if kind is float:
        return float(value)
    return Path(value) if kind is Path else value
