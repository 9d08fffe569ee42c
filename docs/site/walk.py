"""The pictures of `docs/selecting.md`, made by the commands that stand there.

    python docs/site/walk.py [FOLDER]

Without FOLDER they replace those in `docs/images/selecting`. The scene is the benchmark's `tabletop`.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.cli import main as run

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "images" / "selecting"
SCENE = ROOT / "benchmarks" / "data" / "tabletop" / "scene.ply"
COMMANDS = (
    "select tabletop.ply --list-views views --grid",
    "select tabletop.ply --view 3 --click 305 335 --output fern.npy --trim fern",
    "select tabletop.ply --marks fern.json --view 4 --remove-click 253 353 --click 273 347 --output leaves.npy "
    "--trim leaves",
)
"""The walk, as it stands in the document."""
SHOWN = (9, 3, 4)
CLICKS = ((1, (305, 335), (80, 200, 60)), (2, (253, 353), (60, 60, 240)), (2, (273, 347), (80, 200, 60)))
"""Place among the pictures that are shown, pixel and colour of each click."""
WIDTH, QUALITY = 900, 80


def main(folder: Path) -> None:
    """Run the walk in an empty folder, and write its pictures to another."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        shutil.copy(SCENE, Path(place) / "tabletop.ply")
        before = Path.cwd()
        os.chdir(place)
        try:
            for command in COMMANDS:
                if code := run([*command.split(), "--quiet"]):
                    raise SystemExit(f"'{command}' ended with code {code}.")
            views = [cv2.imread(f"views/{number:03d}.png") for number in SHOWN]
            for place_of_view, pixel, colour in CLICKS:
                cv2.circle(views[place_of_view], pixel, 12, colour, 4)
            _write(folder / "views.jpg", np.hstack(views))
            for name in ("fern", "leaves"):
                _write(folder / f"{name}.jpg", cv2.imread(f"{name}/before_after.png"))
        finally:
            os.chdir(before)


def _write(path: Path, picture: np.ndarray) -> None:
    height = round(WIDTH * picture.shape[0] / picture.shape[1])
    small = cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
