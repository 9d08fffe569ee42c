"""The commands of `gaussian-trimmer`: a dataclass each, whose fields are the options and whose `run` does the work.

The table is all that is loaded before a command is called.
"""

from __future__ import annotations

from gaussian_trimmer.lazy_import import load

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

# Name -> dataclass of the options, and a line of help.
COMMANDS = {
    "trim": ("gaussian_trimmer.commands.trim:Trim", "sharpen a rough selection of one object"),
    "batch": ("gaussian_trimmer.commands.batch:Batch", "trim many objects of many scenes, from a table"),
    "demo": ("gaussian_trimmer.commands.demo:Demo", "trim an object of the sample scene"),
    "info": ("gaussian_trimmer.commands.info:Info", "say what a splat, selection or camera file holds"),
    "convert": ("gaussian_trimmer.commands.convert:Convert", "convert between splat formats"),
    "select": ("gaussian_trimmer.commands.select:Select", "make a rough selection from a click, a box or masks"),
    "objects": ("gaussian_trimmer.commands.objects:Objects", "find every object of a scene, without a click"),
    "view": ("gaussian_trimmer.commands.view:View", "mark, trim and look in the browser"),
    "evaluate": ("gaussian_trimmer.commands.evaluate:Evaluate", "compare a trim with ground-truth masks"),
    "evaluate removal": (
        "gaussian_trimmer.commands.evaluate:EvaluateRemoval",
        "compare the scene without an object with pictures of it",
    ),
    "evaluate nvos": (
        "gaussian_trimmer.commands.evaluate_dataset:Nvos",
        "score a method on NVOS, before and after trimming",
    ),
    "evaluate lerf-mask": ("gaussian_trimmer.commands.evaluate_dataset:LerfMask", "the same on LERF-Mask"),
    "evaluate lerf-ovs": ("gaussian_trimmer.commands.evaluate_dataset:LerfOvs", "the same on LERF-OVS"),
    "completion": ("gaussian_trimmer.commands.completion:Completion", "make bash or zsh complete commands"),
}
"""A command of two words goes before the command of its first word."""


def kind_of(name: str) -> type[Any]:
    """The dataclass of a command, by its name in `COMMANDS`."""
    kind: type[Any] = load(COMMANDS[name][0])
    return kind
