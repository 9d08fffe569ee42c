"""Arguments that several commands share: the scene, marks, and what is said of a trim.

Marks are clicks, boxes and selection files, which take effect in the order in which they are given.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.output.engines import EngineName, Origin, PlacingOptions
from gaussian_trimmer.parser import UP, Parser
from gaussian_trimmer.selecting.marks import Box, Click, Effect, FromFile, Grow, Mark, Shrink
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range, hints_of, with_settings

TYPE_CHECKING = False
if TYPE_CHECKING:  # readers and converters need no trimmer
    from gaussian_trimmer.trimming.config import TrimConfig

LEVEL = "Level of detail of a streamed SOG, 0 is the finest; by default the finest that memory allows"
TRUST = "Open pictures that a transforms.json names outside its folder, if it does not say their size"
CAMERAS = "Training cameras: a COLMAP folder, transforms.json or cameras.json"
_Spacings = Annotated[float, Range(0.01, 1000)]
_IDS = re.compile(r"(?P<path>.+)#(?P<ids>-?\d+(?:,-?\d+)*)")
_VIEWS = ("view", "view_index")
_PIXELS = ("click", "remove_click", "box", "remove_box")
_EFFECTS: dict[str, Effect] = {"add": "add", "subtract": "remove", "intersect": "intersect"}
_OPTIONS: tuple[tuple[str, Any, str, str], ...] = (
    ("--view", str, "NAME", "View of the clicks and boxes that follow, by the name or number of its picture"),
    ("--view-index", int, "INT", "The same by its number, from 0"),
    ("--click", tuple[int, int], "X Y", "Pixel on the object, or in the middle of what is missing"),
    ("--remove-click", tuple[int, int], "X Y", "Pixel in the middle of what is selected but should not be"),
    ("--box", tuple[int, int, int, int], "X0 Y0 X1 Y1", "Box around the object: left, top, right, bottom"),
    ("--remove-box", tuple[int, int, int, int], "X0 Y0 X1 Y1", "Box around what should not be selected"),
    ("--add", str, "FILE[#ID,...]", "Add what a selection file of any kind selects; #ID picks objects in it"),
    ("--subtract", str, "FILE[#ID,...]", "Take away what a selection file selects"),
    ("--intersect", str, "FILE[#ID,...]", "Keep only what a selection file selects"),
    ("--grow", _Spacings, "SPACINGS", "Add what lies this near to the selection, in distances between neighbours"),
    ("--shrink", _Spacings, "SPACINGS", "Take away what lies this near to what is not selected"),
)


def add_scene(parser: Parser, **more: Any) -> None:
    """Add the scene and its cameras, and how they are read; `more` is for the scene."""
    scene = "Splat file of the scene, or the folder of a training"
    parser.add_argument("scene", kind=Path, metavar="SCENE", help=scene, **more)
    group = parser.add_argument_group("the scene")
    group.add_argument("--cameras", kind=Path, help=CAMERAS)
    group.add_argument("--up", kind=UP, help="Which way is up; by default found from the cameras or the ground")
    group.add_argument("--level", kind=int, metavar="N", help=LEVEL, rare=True)
    group.add_argument("--trust-paths", kind=bool, help=TRUST, rare=True)


def add_stages(group: Any, parser: Parser, *, rare: bool = False) -> None:
    """Add preset, number of views, and every setting of the stages of a trim."""
    from gaussian_trimmer.trimming.config import TrimConfig
    from gaussian_trimmer.views.virtual_cameras import PlanConfig

    preset = "Defaults of all settings: this program's, or the GaussianTrimmer paper's"
    group.add_argument("--preset", kind=Literal["default", "paper"], default="default", help=preset, rare=rare)
    views = "Number of virtual views, usually 5"
    group.add_argument("--views", kind=hints_of(PlanConfig)["views"], help=views, rare=rare)
    parser.add_settings(group, TrimConfig, selection=SelectionOptions)


def add_trimming(parser: Parser, *, rare: bool = False) -> None:
    """Add how an object is trimmed, and in which files it is written."""
    from gaussian_trimmer.trimming.config import TrimConfig

    group, config = parser.add_argument_group("how to trim"), hints_of(TrimConfig)
    add_stages(group, parser, rare=rare)
    sam = "Folder of a SAM or SAM 2 that draws the object's masks in the views"
    group.add_argument("--sam", kind=Path, metavar="DIR", help=sam, rare=rare)
    outline, scene = "Fit the object's outline, or leave whole Gaussians", "How the scene without the object is made"
    group.add_argument("--refine", kind=config["refine"], help=outline, rare=rare)
    group.add_argument("--background", kind=config["background"], help=scene, rare=rare)
    stands = "What stands on the object goes with it"
    group.add_argument("--with-what-stands-on-it", kind=bool, help=stands, rare=True)
    group = parser.add_argument_group("files")
    ending = "Format of object and background; by default the scene's"
    group.add_argument("--format", metavar="ENDING", help=ending, rare=rare)
    programs = "Also files for this program: upright, the foot at the origin, in a format that it reads"
    add_placing(group, f"{programs}; a mask for gsplat; instances: all objects in one PLY with their ids", rare)
    background = "Make and write the scene without the objects, which is nearly as large as the scene"
    group.add_argument("--write-background", kind=bool, default=True, help=background, rare=True)
    page = "Also report.html, a page with views before and after and all numbers"
    group.add_argument("--html", kind=bool, help=page, rare=rare)


def add_placing(group: Any, engine: str, rare: bool = False) -> None:
    """Add how files for other programs are placed."""
    origin, scale = "What lies at the origin of those files", "Their units in a unit of the scene"
    group.add_argument("--for", dest="engine", kind=EngineName, help=engine, rare=rare)
    group.add_argument("--origin", kind=Origin, help=origin, rare=True)
    group.add_argument("--scale", kind=Annotated[float, Range(1e-6, 1e6)], default=1.0, help=scale, rare=True)


def config_of(arguments: Namespace) -> TrimConfig:
    """Return the settings of all stages."""
    from gaussian_trimmer.trimming.config import TrimConfig, paper_config

    config = paper_config() if arguments.preset == "paper" else TrimConfig()
    config = with_settings(config, arguments.settings)
    if arguments.views is not None:
        config = replace(config, plan=replace(config.plan, views=arguments.views))
    flags = {name: getattr(arguments, name, None) for name in ("up", "refine", "background", "with_what_stands_on_it")}
    if not getattr(arguments, "write_background", True):
        flags["background"] = "exact"  # What is not written is not made.
    return replace(config, **{name: value for name, value in flags.items() if value})


def selection_options_of(arguments: Namespace) -> SelectionOptions:
    """Return how selection files are read."""
    return with_settings(SelectionOptions(), arguments.settings, "selection")


def placing_of(arguments: Namespace) -> PlacingOptions:
    """Return how files for other programs are placed."""
    return PlacingOptions(arguments.engine, arguments.origin, arguments.scale)


def suffix_for(arguments: Namespace) -> str:
    """Return the ending of the splat files that are written.

    Raises:
        InputError: no format has the name that is given, or a folder holds no scene.
    """
    from gaussian_trimmer.output.saving import suffix_of

    if arguments.format is None:
        return formats.written_suffix(identify(arguments.scene).scene)
    return suffix_of(arguments.format)


def add_marks(parser: Parser, *, rare: bool = False) -> None:
    """Add what to select. Marks apply in the order given, and each may be repeated."""
    group = parser.add_argument_group("marks, in any number and order")
    for flag, kind, metavar, help in _OPTIONS:
        group.add_argument(flag, action="mark", kind=kind, metavar=metavar, help=help, rare=rare)


def marks_of(arguments: Namespace) -> list[Mark]:
    """Return the marks, in order; views by name or number. A single view may also follow its pixels.

    Raises:
        InputError: a click or a box has no view, or a view has neither.
    """
    names, views = [name for name, _ in arguments.in_order], views_of(arguments)
    if views and not set(names) & set(_PIXELS) and "selection.query-point" not in arguments.settings:
        raise InputError(
            "--view names the picture of a --click or --box, and there is none; leave it out. The number of virtual "
            "views is --views."
        )
    for name, following in pairwise([*names, "view"] if len(views) > 1 else ()):
        if name in _VIEWS and following in _VIEWS:
            raise InputError("A view has no --click or --box after it, before the next one; leave it out.")
    current, marks = views[0] if len(views) == 1 else None, list[Mark]()
    for name, value in arguments.in_order:
        if name in _VIEWS:
            current = value
        elif name in _EFFECTS:
            path, ids = _file(value)
            marks.append(FromFile(path, SelectionOptions(object_id=ids), _EFFECTS[name]))
        elif name in ("grow", "shrink"):
            marks.append(Grow(value) if name == "grow" else Shrink(value))
        elif current is None and views:
            kind = name.rpartition("_")[2]
            raise InputError(f"A {kind} comes before the first of several views; name its view before it: --view NAME.")
        elif current is None:
            raise InputError("Name the view of the pixels: --view NAME or --view-index INT (see --list-views DIR).")
        else:
            mark: Any = Click if name.endswith("click") else Box
            marks.append(mark(*value, current, "remove" if name.startswith("remove") else "add"))
    return marks


def views_of(arguments: Namespace) -> list[str | int]:
    """Return the views that are named, in order."""
    return [value for name, value in arguments.in_order if name in _VIEWS]


def mark_files(arguments: Namespace) -> Iterator[Path]:
    """Yield the selection files that are combined."""
    return (_file(value)[0] for name, value in arguments.in_order if name in _EFFECTS)


def _file(text: str) -> tuple[Path, tuple[int, ...]]:
    """Return a path, and the ids behind the # at its end; a # that is part of an existing file's name stays in it."""
    found = _IDS.fullmatch(text)
    if found is None or Path(text).exists():
        return Path(text), ()
    return Path(found["path"]), tuple(map(int, found["ids"].split(",")))
