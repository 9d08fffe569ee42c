"""Captures that are hard to trim, with ground truth: sparse ones, hazy ones, and rooms with things at their walls.

    python benchmarks/captures.py refit SCENE OUTPUT --count 8000 [--haze 0.05]
    python benchmarks/captures.py rooms OUTPUT --counts 25000 25000 9000
    python benchmarks/captures.py rooms OUTPUT --rooms gravel lawn --counts 40000 40000
    python benchmarks/captures.py rooms OUTPUT --rooms glossy turntable --counts 8000 15000 --haze 0.05

`refit` takes a benchmark scene (see benchmark_scenes.py) and lets fewer, larger Gaussians learn the pictures that the
scene itself shows at its cameras (refits.py); masks, pictures and cameras stay those of the scene. `rooms` does so with
rooms made of surfaces (rooms.py), whose masks are the shares of things in the rooms' own pictures. Each is written as a
benchmark scene OUTPUT/<name>, which appears whole or not at all, with the rough selections of the others:

    exact           more than half of the blend weight lies within the masks of the training views
    dilated         the same with masks grown by 3 px
    eroded          ... shrunk by 2 px
    wobbly          ... bent by some 4 px
    three_views     ... of three training views only, so that what lies far behind or before is selected as well
    centre_vote     the centre is within the mask in most of the training views that have it in the picture
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
from benchmark_scenes import BenchmarkScene, open_scene
from numpy.typing import NDArray
from quality import parser_of
from refits import coloured, fit, floaters, photograph, psnr, shrunk, thinned
from rooms import ROOMS, Room, make_room

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import write
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate
from gaussian_trimmer.rendering.tile_renderer import draw

ByteArray = NDArray[np.uint8]
Masks = Mapping[str, Mapping[str, ByteArray]]
"""Coverage, 0 to 255, (H, W), of each object in each view, by their names."""

BURIED_SHARE = 0.02
"""Share of a room's Gaussians that lie inside the things, where training leaves dark ones that no view shows."""
SETTLING_SHARE = 0.15
"""Steps that fit a scene after haze was added, as a share of those before."""
GROWN_PIXELS, SHRUNK_PIXELS, BENT_PIXELS, BEND_LENGTH = 3, 2, 4.0, 25.0
VOTE_SHARE = 0.6
LEAST_WEIGHT = 1e-3
"""Blend weight over all views, in pixels, below which a Gaussian is not seen."""


@dataclass(frozen=True)
class FitOptions:
    """How the Gaussians learn the pictures."""

    steps: int = 900
    """Steps at a part of the pictures' size."""
    fine_steps: int = 150
    """Steps at their full size after that."""
    scale: float = 0.5
    """Size of the pictures in the first steps, relative to the cameras' own."""
    haze: float = 0.0
    """Large faint Gaussians between cameras and scene, as a share of the others."""
    flaws: float = 1.0
    """How flawed the pictures are, relative to common photographs."""
    seed: int = 0

    def learn(
        self,
        scene: Gaussians,
        cameras: Sequence[Camera],
        count: int,
        buried: Gaussians | None = None,
        seen_from: Callable[[Camera], Gaussians] | None = None,
    ) -> Gaussians:
        """A scene of at most `count` Gaussians that shows what another shows; `buried` ones are some of them.

        `seen_from` gives what each camera saw; not given: the scene.
        """
        rng = np.random.default_rng(self.seed)
        full = photograph(seen_from or (lambda _: scene), cameras, self.flaws, rng)
        views = [shrunk(view, self.scale) for view in full]
        n_haze, inside = round(self.haze / (1 + self.haze) * count), [buried] if buried is not None else []
        chosen = thinned(scene, views, count - n_haze - sum(map(len, inside)), rng)
        learnt = fit(concatenate([chosen, *inside]), views, self.steps, rng)
        if n_haze:
            learnt = concatenate([learnt, floaters(learnt, views, n_haze, rng)])
            learnt = fit(learnt, views, round(SETTLING_SHARE * self.steps), rng)
        return fit(learnt, full, self.fine_steps, rng) if self.fine_steps else learnt


def refit(folder: Path, output: Path, count: int, name: str, options: FitOptions) -> None:
    """Make a benchmark scene seen by fewer Gaussians."""
    scene, start = open_scene(folder), perf_counter()
    name = name or f"{scene.name}_{count / 1000:g}k{'_hazy' if options.haze else ''}"
    cameras = scene.training_cameras
    learnt = options.learn(scene.gaussians, cameras, count)
    views = [*cameras, *(camera for camera, _ in scene.test_frames)]
    masks = {thing: {v.name: _bytes(scene.coverage(thing, v.name)) for v in views} for thing in scene.objects}
    near = [camera for camera, far in scene.test_frames if not far]
    pictures = {c.name: _photo(scene.scene_folder / "images" / c.name) for c, _ in scene.test_frames}
    listing = json.loads(scene.cameras_file.read_text())
    _save(output / name, learnt, listing, pictures, masks, cameras)
    print(_summary(output / name, learnt, near, pictures, perf_counter() - start))


def room(letter: str, count: int, folder: Path, options: FitOptions, coarseness: float, picture_scale: float) -> None:
    """Make a room with things at its walls, seen from the front only."""
    start, made = perf_counter(), make_room(letter, coarseness, picture_scale)
    buried = inside(made, round(BURIED_SHARE * count), np.random.default_rng(options.seed))
    learnt = options.learn(made.gaussians, made.training, count, buried, made.seen_from)
    masks: dict[str, dict[str, ByteArray]] = {name: {} for name in made.names}
    pictures = {}
    for camera in (*made.training, *made.test):
        drawing = draw(made.seen_from(camera), [camera], values=made.labels)
        pictures[camera.name] = _bytes(drawing.rgb[0].transpose(1, 2, 0))
        for name, share in zip(made.names, drawing.values[0], strict=True):
            masks[name][camera.name] = _bytes(share)
    frames = [_frame(camera, split) for split in ("train", "test")
              for camera in (made.training if split == "train" else made.test)]  # fmt: skip
    tests = {camera.name: pictures[camera.name] for camera in made.test}
    _save(folder, learnt, {"up": [0.0, 0.0, 1.0], "frames": frames}, tests, masks, made.training)
    for name in made.names:
        rest = make_room(letter, coarseness, picture_scale, without=name)
        (folder / "removed" / name).mkdir(parents=True)
        for camera in made.test:
            picture = _bytes(draw(rest.seen_from(camera), [camera]).rgb[0].transpose(1, 2, 0))
            cv2.imwrite(str(folder / "removed" / name / camera.name), picture[..., ::-1])
    print(_summary(folder, learnt, made.test, tests, perf_counter() - start))


def main() -> None:
    parser = parser_of(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    of_scene, of_rooms = commands.add_parser("refit"), commands.add_parser("rooms")
    of_scene.add_argument("scene", type=Path, help="folder of the scene")
    of_scene.add_argument("--count", type=int, default=8000, help="number of Gaussians; some are lost on the way")
    of_scene.add_argument("--name", default="", help="of the capture; without it, of scene and count")
    of_rooms.add_argument("--rooms", nargs="+", choices=ROOMS, default=["a", "b", "c"])
    of_rooms.add_argument("--counts", nargs="+", type=int, default=[25_000, 25_000, 9_000], help="Gaussians of each")
    of_rooms.add_argument("--suffix", default="", help="what the folders' names end in, after room_a")
    of_rooms.add_argument("--coarseness", type=float, default=1.0, help="size of the surfaces' Gaussians, relative to "
                          "what the pictures need")  # fmt: skip
    of_rooms.add_argument("--picture-scale", type=float, default=1.0, help="of the pictures, relative to 504 x 378")
    for command in (of_scene, of_rooms):
        command.add_argument("output", type=Path, help="folder for the captures' own folders")
        for field in fields(FitOptions):
            command.add_argument(f"--{field.name.replace('_', '-')}", type=type(field.default), default=field.default)
    given = parser.parse_args()
    options = FitOptions(**{field.name: getattr(given, field.name) for field in fields(FitOptions)})
    if given.command == "refit":
        refit(given.scene, given.output, given.count, given.name, options)
        return
    if len(given.rooms) != len(given.counts):
        raise InputError(f"There are {len(given.rooms)} rooms and {len(given.counts)} counts; give one for each.")
    for letter, count in zip(given.rooms, given.counts, strict=True):
        folder = given.output / f"room_{letter}{given.suffix}"
        room(letter, count, folder, options, given.coarseness, given.picture_scale)


def inside(room: Room, n: int, rng: np.random.Generator) -> Gaussians:
    """Dark Gaussians below the surfaces of a room's things."""
    rows = rng.choice(np.flatnonzero(room.labels.any(axis=1)), n)
    means = room.gaussians.means[rows] - room.normals[rows] * rng.uniform(0.02, 0.1, (n, 1))
    sizes, greys = rng.uniform(0.01, 0.04, (n, 3)), rng.uniform(0.05, 0.4, (n, 1)) + rng.normal(0, 0.02, (n, 3))
    return coloured(means, sizes, greys, rng.uniform(0.2, 0.9, n))


def rough_selections(gaussians: Gaussians, cameras: Sequence[Camera], masks: Masks) -> dict[str, dict[str, BoolArray]]:
    """Rough selections (N,) by object and kind, from the masks of training views."""
    kinds: dict[str, Callable[[ByteArray, np.random.Generator], FloatArray]] = {
        "exact": lambda mask, rng: _whole(mask),
        "dilated": lambda mask, rng: _changed(cv2.dilate, mask, GROWN_PIXELS),
        "eroded": lambda mask, rng: _changed(cv2.erode, mask, SHRUNK_PIXELS),
        "wobbly": lambda mask, rng: bent(_whole(mask), rng),
    }
    names, rng = list(masks), np.random.default_rng(0)
    within, total = np.zeros((len(cameras), len(names), len(kinds), len(gaussians)), np.float32), []
    votes, possible = np.zeros((len(names), len(gaussians))), np.zeros(len(gaussians))
    for i, camera in enumerate(cameras):
        images = [of_kind(masks[name][camera.name], rng) for name in names for of_kind in kinds.values()]
        everywhere = np.ones((camera.height, camera.width), np.float32)
        weights = draw(gaussians, [camera]).weigh([np.stack([*images, everywhere])])[0]
        within[i] = weights[:, :-1].T.reshape(len(names), len(kinds), -1)
        total.append(weights[:, -1])
        pixels, depths = camera.project(gaussians.means.astype(np.float64))
        x, y = np.floor(np.nan_to_num(pixels, nan=-1.0)).astype(np.int64).T
        seen = (depths > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
        possible += seen
        for votes_of, name in zip(votes, names, strict=True):
            votes_of[seen] += masks[name][camera.name][y[seen], x[seen]] > 127
    shown = np.array(total)
    found = {}
    for j, name in enumerate(names):
        found[name] = {kind: _most(within[:, j, k].sum(0), shown.sum(0)) for k, kind in enumerate(kinds)}
        showing = [i for i, camera in enumerate(cameras) if (masks[name][camera.name] > 127).any()]
        few = rng.permutation(showing)[:3]
        found[name]["three_views"] = _most(within[few, j, 0].sum(0), shown[few].sum(0))
        found[name]["centre_vote"] = (possible > 0) & (votes[j] > VOTE_SHARE * possible)
    return found


def bent(mask: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A mask moved by smooth random offsets of some pixels."""
    y, x = np.mgrid[: mask.shape[0], : mask.shape[1]].astype(np.float32)
    offsets = [cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), BEND_LENGTH) for _ in range(2)]
    dx, dy = ((BENT_PIXELS / 2**0.5 * offset / offset.std()).astype(np.float32) for offset in offsets)
    return np.asarray(cv2.remap(mask, x + dx, y + dy, cv2.INTER_NEAREST), np.float32)


def _most(part: FloatArray, whole: FloatArray) -> BoolArray:
    return np.asarray((whole > LEAST_WEIGHT) & (part > 0.5 * whole))


def _whole(mask: ByteArray) -> FloatArray:
    return (mask > 127).astype(np.float32)


def _changed(operation: Callable[..., Any], mask: ByteArray, radius: int) -> FloatArray:
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(operation(_whole(mask), square), np.float32)


def _bytes(picture: FloatArray) -> ByteArray:
    return np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)


def _floats(picture: ByteArray) -> FloatArray:
    return np.asarray(picture.transpose(2, 0, 1) / 255, np.float32)


def _photo(path: Path) -> ByteArray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR), np.uint8)[..., ::-1]


def _frame(camera: Camera, split: str) -> dict[str, object]:
    return {
        "file": camera.name,
        "split": split,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }


def _save(
    folder: Path,
    gaussians: Gaussians,
    listing: dict[str, object],
    pictures: Mapping[str, ByteArray],
    masks: Masks,
    training: Sequence[Camera],
) -> None:
    """Write a benchmark scene under another name, and rename it; what was there under its name is replaced."""
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    for kind in ("images", *(f"masks/{name}" for name in masks)):
        (part / kind).mkdir(parents=True)
    for view, picture in pictures.items():
        cv2.imwrite(str(part / "images" / view), picture[..., ::-1])
    for name, of_name in masks.items():
        for view, mask in of_name.items():
            cv2.imwrite(str(part / "masks" / name / view), mask)
    for name, kinds in rough_selections(gaussians, training, masks).items():
        (part / "coarse" / name).mkdir(parents=True)
        for kind, selection in kinds.items():
            np.save(part / "coarse" / name / f"{kind}.npy", selection)
    write(gaussians, part / "scene.ply")
    (part / "cameras.json").write_text(json.dumps(listing, indent=1))
    shutil.rmtree(folder, ignore_errors=True)
    part.rename(folder)


def _summary(
    folder: Path, gaussians: Gaussians, cameras: Sequence[Camera], pictures: Mapping[str, ByteArray], seconds: float
) -> str:
    """Number, likeness to the pictures of test views, and per object the IoU of `exact` alone and sizes of kinds."""
    likeness = [psnr(draw(gaussians, [c]), _floats(pictures[c.name])) for c in cameras]
    lines = [f"{folder.name}: {len(gaussians)} Gaussians, PSNR {np.mean(likeness):.1f} dB, {seconds:.0f} s"]
    scene = open_scene(folder)
    for name in scene.objects:
        kinds = {kind: scene.coarse(name, kind) for kind in scene.coarse_kinds(name)}
        sizes = ", ".join(f"{kind} {mask.sum() / kinds['exact'].sum():.2f}" for kind, mask in kinds.items())
        lines.append(f"  {name}: {kinds['exact'].sum()} Gaussians, IoU {alone_iou(scene, name):.1f}; {sizes}")
    return "\n".join(lines)


def alone_iou(scene: BenchmarkScene, name: str) -> float:
    """IoU in per cent, over the near test views, of the selection `exact` drawn alone."""
    alone, both, either = scene.gaussians.select(scene.coarse(name, "exact")), 0, 0
    for view in scene.test_views(name):
        if not view.far:
            drawn = draw(alone, [view.camera]).alpha[0] > 0.5
            true, counted = view.coverage > 0.5, view.counted
            both += int((drawn & true & counted).sum())
            either += int(((drawn | true) & counted).sum())
    return 100 * both / max(either, 1)


if __name__ == "__main__":
    main()
