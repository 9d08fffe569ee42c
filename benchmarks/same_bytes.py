"""Do trims give the bytes that they gave before?

    python benchmarks/same_bytes.py ROOT [--source SRC] [--only TEXT] [--against FILE] [--output FILE]

ROOT holds benchmark scenes (see benchmark_scenes.py). About thirty default trims run as a user runs them, each in a
process of its own: dense and sparse scenes, things at walls, photographs, without cameras, several objects at once,
everything that is found, and clicks. With --against, what differs from an earlier --output is named, and the exit code
is 1. SRC is the folder that holds the package, by default that of this checkout; so any commit can be measured.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

DENSE = ["scene0/bottle/dilated", "scene0/boombox/eroded", "scene0/plant/eroded", "scene0/lantern/exact"]
TABLETOP = ["tabletop/robot/dilated", "tabletop/fern/eroded", "tabletop/mug/wobbly", "tabletop/lighthouse/three_views"]
SPARSE = ["sparse/bottle/dilated", "sparse/lantern/centre_vote", "touching/mug/eroded", "touching/books/wobbly"]
WALLS = ["room/bookcase/exact", "room/drawers/dilated", "room/picture_one/eroded", "clutter/guitar/eroded"]
PARTS = ["parts/robot_head/dilated", "flat/towel/exact"]
OTHERS = ["flower/flower/dilated", "horns/left/exact", "foliage/fern/dilated"]
WITHOUT_CAMERAS = ["scene0/bottle/dilated", "tabletop/robot/exact", "sparse/boombox/dilated", "room/drawers/exact"]
SEVERAL = {"tabletop": ("robot", "mug", "fern"), "touching": ("mug", "books", "present")}
FOUND = ["tabletop", "sparse"]
CLICKS = {"tabletop/robot": "", "scene0/bottle": "", "touching/banana": ""}


def commands(root: Path, scratch: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the name and the arguments of each trim, without its output."""
    for name in [*DENSE, *TABLETOP, *SPARSE, *WALLS, *PARTS, *OTHERS]:
        yield name, [*_trim(root, name), *_cameras(root / name.split("/")[0])]
    for name in WITHOUT_CAMERAS:
        copy = scratch / f"{name.split('/')[0]}.ply"
        if not copy.is_file():
            copy.write_bytes((root / name.split("/")[0] / "scene.ply").read_bytes())
        yield f"{name} without cameras", ["trim", str(copy), _trim(root, name)[2]]
    for scene, objects in SEVERAL.items():
        labels = scratch / f"{scene}-labels.npy"
        np.save(labels, _labels(root / scene, objects))
        words = ["trim", str(root / scene / "scene.ply"), "--labels", str(labels)]
        yield f"{scene} several", [*words, *_cameras(root / scene)]
    for scene in FOUND:
        # Nothing is sure while up is a guess.
        yield f"{scene} objects", ["objects", str(root / scene), *_cameras(root / scene), "--trim"]
    for name in CLICKS:
        view, x, y = _click(root, name)
        folder = root / name.split("/")[0]
        marks = ["--view", view, "--click", str(x), str(y)]
        yield f"{name} click", ["select", str(folder), *_cameras(folder), *marks, "--trim"]


def _cameras(scene: Path) -> list[str]:
    return ["--cameras", str(scene / "cameras.json")]


def _trim(root: Path, name: str) -> list[str]:
    scene, thing, kind = name.split("/")
    return ["trim", str(root / scene / "scene.ply"), str(root / scene / "coarse" / thing / f"{kind}.npy")]


def _labels(scene: Path, objects: tuple[str, ...]) -> np.ndarray:
    masks = [np.load(scene / "coarse" / name / "dilated.npy") for name in objects]
    labels = np.zeros(len(masks[0]), np.int32)
    for number, mask in reversed(list(enumerate(masks, 1))):
        labels[mask] = number
    return labels


def _click(root: Path, name: str) -> tuple[str, int, int]:
    """Return the training view that shows most of an object, and its pixel farthest from the mask's edge."""
    import cv2

    scene, thing = name.split("/")
    cameras = json.loads((root / scene / "cameras.json").read_text())
    frames = cameras["cameras"] if isinstance(cameras, dict) and "cameras" in cameras else cameras["frames"]
    best: tuple[int, str, np.ndarray] | None = None
    for frame in frames:
        file = root / scene / "masks" / thing / f"{Path(frame['file']).stem}.png"
        if frame.get("split") == "train" and file.is_file():
            mask: np.ndarray = np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)) > 127
            if best is None or np.count_nonzero(mask) > best[0]:
                best = int(np.count_nonzero(mask)), frame["file"], mask
    assert best is not None
    padded = np.pad(best[2].astype(np.uint8), 1)
    y, x = divmod(int(cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1].argmax()), best[2].shape[1])
    return best[1], x, y


def _hash(folder: Path) -> dict[str, str]:
    """Return the hashes of all splats and labels below a folder, by their paths."""
    hashes = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".ply":
            hashes[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        elif path.name == "labels.npz":
            with np.load(path) as arrays:
                parts = b"".join(key.encode() + arrays[key].tobytes() for key in sorted(arrays.files))
            hashes[str(path.relative_to(folder))] = hashlib.sha256(parts).hexdigest()[:16]
    return hashes


def main() -> int:
    """Run the trims, print and compare their hashes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("--source", type=Path, default=Path(__file__).parents[1] / "src")
    parser.add_argument("--only", default="", help="only trims whose names contain this text")
    parser.add_argument("--against", type=Path)
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    known = json.loads(arguments.against.read_text()) if arguments.against else {}
    environment = os.environ | {"PYTHONPATH": str(arguments.source.resolve())}
    found: dict[str, dict[str, str]] = {}
    differing = 0
    with tempfile.TemporaryDirectory() as scratch:
        for name, command in commands(arguments.root.resolve(), Path(scratch)):
            if arguments.only not in name:
                continue
            folder = Path(scratch) / "results" / name.replace("/", "-").replace(" ", "-")
            ending = [str(folder)] if command[-1] == "--trim" else ["--output", str(folder)]
            run = [sys.executable, "-m", "gaussian_trimmer", *command, *ending, "--quiet"]
            ended = subprocess.run(run, env=environment, cwd=scratch, capture_output=True, text=True, check=False)
            found[name] = _hash(folder) or {"error": f"{ended.returncode} {ended.stderr[-500:]}"}
            same = not known or known.get(name) == found[name]
            differing += not same
            told = "done" if not known else "same" if same else "DIFFERS"
            print(f"{told:8}{name}  {'' if same and 'error' not in found[name] else found[name]}", flush=True)
    if arguments.output:
        arguments.output.write_text(json.dumps(found, indent=1) + "\n")
    print(f"{len(found)} trims" + (f", {differing} differ" if known else ""))
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
