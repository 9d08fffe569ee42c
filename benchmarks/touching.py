"""Can things that touch be parted by two clicks: one on the thing that is meant, one that takes another away?

    python benchmarks/touching.py ROOT [--output FILE]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. Each object is selected by a click as in clicks.py.
Wherever that takes some of another object along, a second click takes the other one away, in the training view whose
mask of it is largest, on the pixel farthest from the mask's edge. Both are parted if more than 0.9 of the Gaussians of
the first stay that are its own, and less than 0.1 of the other's.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmark_scenes import BenchmarkScene, find_captures, open_scene
from clicks import best_view, middle_of
from quality import parser_of

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.selecting.marks import Click, Mark
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.trimming.up_vector import find_up

_MIN_KEPT, _MAX_LEFT = 0.9, 0.1


@dataclass(frozen=True)
class Row:
    """Two objects, and how they were parted."""

    scene: str
    meant: str
    other: str
    taken: float
    """Share of the other one's own Gaussians that the first click takes along."""
    kept: float
    """Share of those of the object that is meant which are selected in the end."""
    left: float
    """Share of those of the other one that are."""

    @property
    def parted(self) -> bool:
        """Whether the object that is meant is selected, and the other one is not."""
        return self.kept > _MIN_KEPT and self.left < _MAX_LEFT


def main() -> None:
    """Part each pair of objects."""
    parser = parser_of(__doc__)
    parser.add_argument("root", type=Path, help="folder with benchmark scenes, or one scene")
    parser.add_argument("--output", type=Path, help="write all rows to this JSON file")
    arguments = parser.parse_args()
    rows = []
    for folder in find_captures(arguments.root):
        for row in _measure(open_scene(folder)):
            rows.append(row)
            print(
                f"{row.scene + '/' + row.meant:24s} without {row.other:12s} taken {row.taken:.2f} kept {row.kept:.2f} "
                f"left {row.left:.2f}  {'parted' if row.parted else '-'}",
                flush=True,
            )
    along = [row for row in rows if row.taken >= _MAX_LEFT]
    print(f"{sum(row.parted for row in along)} of {len(along)} pairs parted by a second click", end="; ")
    print(f"{sum(row.parted for row in rows)} of {len(rows)} in all")
    if arguments.output:
        arguments.output.write_text(json.dumps([asdict(row) for row in rows], indent=1))


def _measure(scene: BenchmarkScene) -> Iterator[Row]:
    cameras = only_training(read_camera_set(scene.folder / "cameras.json"))
    up = find_up(scene.gaussians, cameras, scene.up).direction
    own = _own_rows({name: scene.coarse(name, "exact") for name in scene.objects})
    clicks = {}
    for name in scene.objects:
        camera, mask = best_view(scene, name)
        clicks[name] = *middle_of(mask), camera

    def shares(marks: list[Mark]) -> dict[str, float] | None:
        try:
            selected = select(scene.gaussians, marks, cameras=cameras, up=up).mask
        except InputError:  # what does not show as selected cannot be clicked away
            return None
        return {name: float(selected[rows].mean()) for name, rows in own.items()}

    for meant in scene.objects:
        first = Click(*clicks[meant])
        found = shares([first]) or dict.fromkeys(own, 0.0)
        for other in scene.objects:
            if other == meant:
                continue
            along = found[other] >= _MAX_LEFT
            after = (shares([first, Click(*clicks[other], "remove")]) if along else None) or found
            yield Row(scene.name, meant, other, found[other], after[meant], after[other])


def _own_rows(selections: dict[str, BoolArray]) -> dict[str, BoolArray]:
    """What only one of several selections has, each (N,)."""
    count = np.sum(list(selections.values()), axis=0)
    return {name: mask & (count == 1) for name, mask in selections.items()}


if __name__ == "__main__":
    main()
