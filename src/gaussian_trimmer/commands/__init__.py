"""The commands of `gaussian-trimmer`: a module each, whose `add_arguments` says what it takes and what runs it.

The table is all that is loaded before a command is called.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from gaussian_trimmer.parser import Parser

COMMANDS = {
    "trim": ("trim", "sharpen a rough selection of one object"),
    "batch": ("batch", "trim many objects of many scenes, from a table"),
    "demo": ("trim", "trim an object of the sample scene"),
    "info": ("info", "say what a splat, selection or camera file holds"),
    "convert": ("convert", "convert between splat formats"),
    "select": ("select", "make a rough selection from a click, a box or masks"),
    "objects": ("objects", "find every object of a scene, without a click"),
    "view": ("view", "mark, trim and look in the browser"),
    "evaluate": ("evaluate", "compare a trim with ground-truth masks"),
    "evaluate removal": ("evaluate", "compare the scene without an object with pictures of it"),
    "evaluate nvos": ("evaluate_dataset", "score a method on NVOS, before and after trimming"),
    "evaluate lerf-mask": ("evaluate_dataset", "the same on LERF-Mask"),
    "evaluate lerf-ovs": ("evaluate_dataset", "the same on LERF-OVS"),
}
"""Name -> its module, and a line of help. A command of two words goes before the command of its first word."""


def parser_of(name: str) -> Parser:
    """Return what reads the words of a command, by its name in `COMMANDS`."""
    from importlib import import_module

    from gaussian_trimmer.commands.gone import GONE
    from gaussian_trimmer.parser import Parser

    parser = Parser(name, GONE)
    import_module(f"gaussian_trimmer.commands.{COMMANDS[name][0]}").add_arguments(parser)
    return parser


def command_in(words: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return the name of the command that words begin with, and the words after it.

    >>> command_in(["evaluate", "removal", "out"])
    ('evaluate removal', ['out'])
    """
    two = " ".join(words[:2])
    return (two, words[2:]) if two in COMMANDS else (words[0], words[1:])
