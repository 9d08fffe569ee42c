"""Layouts of published data sets with ground-truth masks, each a module, and the table of those that exist.

A module has

- `TITLE`: the name of the data set,
- `find_tasks(root)`: its tasks, targets bound to pictures by name,
- `MEAN`: whether means are taken over tasks, or over the means of scenes,
- `EXPECTED`: number of tasks that the published means are of,
- `PUBLISHED`: published figures, to stand beside.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from gaussian_trimmer.evaluation.layouts.tasks import LayoutTask, Published

LAYOUTS = {
    "nvos": "gaussian_trimmer.evaluation.layouts.nvos",
    "lerf-mask": "gaussian_trimmer.evaluation.layouts.lerf_mask",
    "spin-nerf": "gaussian_trimmer.evaluation.layouts.spin_nerf",
}


class Layout(Protocol):
    """What the module of a layout has."""

    TITLE: str
    MEAN: str
    EXPECTED: int
    PUBLISHED: Sequence[Published]

    def find_tasks(self, root: Path) -> list[LayoutTask]:
        """The tasks below a folder, by name.

        Raises:
            InputError: the folder has another layout, or a task lacks its target.
        """
        ...


def get_layout(name: str) -> Layout:
    """The layout of that name, one of `LAYOUTS`."""
    return cast(Layout, import_module(LAYOUTS[name]))
