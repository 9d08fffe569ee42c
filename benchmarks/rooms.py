"""Rooms with things at their walls, and things on grounds with relief, on a glossy table and on a turntable.

All surfaces are covered with small flat Gaussians.

A room's back wall is y = 0, the floor z = 0, and the cameras stand on an arc before the wall; lengths are in metres.
Light is a shade by the direction of a surface, and a soft shadow around things on walls and floor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from bodies import Part, Texture, checks, grain, mirrored, painting, plain
from scipy.spatial import cKDTree

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import (
    SH_C0,
    BoolArray,
    Float64Array,
    FloatArray,
    Gaussians,
    logit,
    quaternions_of,
    rotation_matrices,
)

WIDTH, HEIGHT = 504, 378
FOV_RADIANS = np.radians(66)
ROOM_SPACING, THING_SPACING = 0.018, 0.012
FLATNESS = 0.1
LIGHT = np.array([0.35, 0.8, 0.5]) / np.linalg.norm([0.35, 0.8, 0.5])
SHADOW_DEPTH, SHADOW_REACH = 0.5, 0.07
UP = np.array([0.0, 0.0, 1.0])
TURNED_ABOUT = np.array([0.0, 0.3, 0.0])
"""Where the cameras look, and about which a turntable turns."""
TURNTABLE_RADIUS = 1.15


@dataclass(frozen=True, eq=False)
class Room:
    """A scene, which of its Gaussians belong to which thing, and cameras."""

    gaussians: Gaussians
    normals: Float64Array
    """Outward directions of the surfaces, (N, 3)."""
    labels: FloatArray
    """Which thing each Gaussian is of: one or zero, (N, things)."""
    names: tuple[str, ...]
    training: list[Camera]
    test: list[Camera]
    standing: BoolArray
    """Gaussians that do not turn with the things on a turntable, (N,)."""

    def seen_from(self, camera: Camera) -> Gaussians:
        """The scene as a camera found it: what does not turn is where the first camera saw it, relative to itself."""
        if not self.standing.any():
            return self.gaussians
        angle, first = (np.arctan2(c.centre[1] - TURNED_ABOUT[1], c.centre[0]) for c in (camera, self.training[0]))
        c, s = np.cos(angle - first), np.sin(angle - first)
        turn, rest = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), self.standing
        means, quaternions = self.gaussians.means.copy(), self.gaussians.quaternions.copy()
        means[rest] = (means[rest] - TURNED_ABOUT) @ turn.T + TURNED_ABOUT
        quaternions[rest] = quaternions_of(turn @ rotation_matrices(quaternions[rest]))
        return self.gaussians.replace(means=means, quaternions=quaternions)


def make_room(letter: str, coarseness: float = 1.0, picture_scale: float = 1.0, without: str | None = None) -> Room:
    """The room of a name in ROOMS; its Gaussians are `coarseness` times as far apart, its pictures scaled by a factor.

    `without` is the name of a thing that does not stand there: neither it nor its shadow is seen.
    """
    rng = np.random.default_rng(ord(letter[0]))
    shell, things, arc = ROOMS[letter](rng)
    things = {name: parts for name, parts in things.items() if name != without}
    bodies = [(part, ROOM_SPACING, -1) for part in shell]
    bodies += [(part, THING_SPACING, i) for i, parts in enumerate(things.values()) for part in parts]
    if letter == "glossy":
        bodies += [(mirrored(part), THING_SPACING, -1) for parts in things.values() for part in parts]
    solid = [part for parts in things.values() for part in parts]
    points, normals, colours, spacings, owners, opacities = [], [], [], [], [], []
    for part, spacing, owner in bodies:
        where, facing = part.sample(coarseness * spacing, rng)
        shade = 0.72 + 0.28 * np.maximum(facing @ LIGHT, 0)
        if owner < 0:
            distance = np.min([thing.distance(where) for thing in solid], axis=0)
            shade = shade * (1 - SHADOW_DEPTH * np.exp(-distance / SHADOW_REACH))
        points.append(where)
        normals.append(facing)
        colours.append(part.texture(where) * shade[:, None])
        spacings.append(np.full(len(where), coarseness * spacing))
        owners.append(np.full(len(where), owner))
        opacities.append(np.full(len(where), part.opacity))
    facing, owner_of = np.concatenate(normals), np.concatenate(owners)
    gaussians = discs(np.concatenate(points), facing, np.concatenate(colours), np.concatenate(spacings))
    gaussians = gaussians.replace(opacity_logits=logit(np.concatenate(opacities)))
    labels = (owner_of[:, None] == np.arange(len(things))).astype(np.float32)
    training, test = ([camera.resized(picture_scale) for camera in cameras] for cameras in _cameras(*arc, rng))
    far = np.linalg.norm(gaussians.means[:, :2] - TURNED_ABOUT[:2], axis=1) > TURNTABLE_RADIUS
    standing = far if letter == "turntable" else np.zeros(len(gaussians), np.bool_)
    return Room(gaussians, facing, labels, tuple(things), training, test, standing)


def discs(points: Float64Array, normals: Float64Array, colours: Float64Array, spacings: Float64Array) -> Gaussians:
    across = np.cross(normals, np.where(abs(normals[:, 2:]) > 0.9, [[1.0, 0, 0]], [UP]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([across, np.cross(normals, across), normals], axis=2)
    scales = 0.65 * spacings[:, None] * [1, 1, FLATNESS]
    logits = np.zeros(len(points))
    sh_dc = (np.clip(colours, 0, 1) - 0.5) / SH_C0
    rest = np.zeros((len(points), 3, 0))
    return Gaussians(points, np.log(scales), quaternions_of(frames), logits, sh_dc, rest)  # type: ignore[arg-type]


def _cameras(first: float, last: float, x: float, rng: np.random.Generator) -> tuple[list[Camera], list[Camera]]:
    """40 training views in three rows and 8 test views between them, from `first` to `last` degrees about (x, 0.3)."""
    lens = intrinsics(FOV_RADIANS, WIDTH, HEIGHT)

    def stand(angle: float, height: float, distance: float, name: str) -> Camera:
        turn, target = np.radians(angle), np.array([x, 0.3, 0.95]) + rng.normal(0, 0.05, 3)
        place = np.array([x + distance * np.sin(turn), 0.3 + distance * np.cos(turn), height])
        return Camera(look_at(place, target, UP), lens, WIDTH, HEIGHT, name)

    training: list[Camera] = []
    for height, n in ((0.55, 13), (1.2, 14), (1.85, 13)):
        for i, angle in enumerate(np.linspace(first, last, n)):
            training.append(stand(angle, height, (2.2, 2.6, 2.9)[i % 3], f"train_{len(training):03d}.png"))
    angles = np.linspace(first + 8, last - 8, 8)
    test = [stand(a, (0.9, 1.5)[i % 2], (2.4, 2.75)[i // 2 % 2], f"test_{i:03d}.png") for i, a in enumerate(angles)]
    return training, test


Plan = tuple[list[Part], dict[str, list[Part]], tuple[float, float, float]]
"""Walls and floor, things, and the arc of the cameras: first and last angle, and x of its middle."""
Relief = Callable[[Float64Array], tuple[Float64Array, Float64Array]]
"""Heights and shades (n,) of a ground at positions (n, 2)."""


def _shell(left: float, wall: Texture, floor: Texture, height: float = 2.9) -> list[Part]:
    right, deep = 3.2, 3.7
    middle, width = (left + right) / 2, right - left
    return [
        Part((middle, 0, height / 2), (width, 0, height), wall),
        Part((left, deep / 2, height / 2), (0, deep, height), wall),
        Part((right, deep / 2, height / 2), (0, deep, height), wall),
        Part((middle, deep / 2, 0), (width, deep, 0), floor),
    ]


def bookcase(x: float, width: float, height: float, wood: Texture, rng: np.random.Generator) -> list[Part]:
    deep, board, shelves = 0.28, 0.022, 5
    sides = (x - width / 2, x + width / 2)
    parts = [Part((side, deep / 2, height / 2), (board, deep, height), wood) for side in sides]
    parts.append(Part((x, 0.01, height / 2), (width, 0.012, height), wood))
    room = (height - board) / shelves
    for shelf in range(shelves + 1):
        parts.append(Part((x, deep / 2, board / 2 + shelf * room), (width, deep, board), wood))
        place = sides[0] + 0.03
        while shelf < shelves and place < sides[1] - 0.08:
            thick, tall = rng.uniform(0.025, 0.06), room * rng.uniform(0.6, 0.85)
            if rng.random() < 0.88:
                book = plain(*np.clip(rng.uniform(0.1, 0.85) + rng.normal(0, 0.16, 3), 0.05, 0.9))
                z = board + shelf * room + tall / 2
                parts.append(Part((place + thick / 2, 0.12, z), (thick - 0.003, 0.19, tall), book))
            place += thick
    return parts


def picture(x: float, z: float, width: float, height: float, frame: Texture, seed: int) -> list[Part]:
    wide, deep = 0.035, 0.025
    parts = [Part((x, 0.01, z), (width - wide, 0.014, height - wide), painting(seed))]
    for side in (-1, 1):
        parts.append(Part((x + side * (width - wide) / 2, deep / 2, z), (wide, deep, height), frame))
        parts.append(Part((x, deep / 2, z + side * (height - wide) / 2), (width, deep, wide), frame))
    return parts


def cabinet(
    low: Sequence[float], size: Sequence[float], panels: tuple[int, int], body: Texture, knob: Texture
) -> list[Part]:
    """A body whose front is made of panels, columns x rows, with gaps between them and a knob on each."""
    centre = [a + s / 2 for a, s in zip(low, size, strict=True)]
    parts = [Part((centre[0], centre[1], centre[2]), (size[0], size[1], size[2]), body)]
    wide, tall, front = size[0] / panels[0], size[2] / panels[1], low[1] + size[1]
    for i in range(panels[0]):
        for j in range(panels[1]):
            x, z = low[0] + (i + 0.5) * wide, low[2] + (j + 0.5) * tall
            parts.append(Part((x, front + 0.01, z), (wide - 0.03, 0.02, tall - 0.03), body))
            parts.append(Part((x, front + 0.035, z), (0.09 if panels[1] > 1 else 0.03, 0.025, 0.025), knob))
    return parts


def lamp() -> list[Part]:
    return [
        Part((1.25, 0.3, 0.015), (0.28, 0.28, 0.03), plain(0.2, 0.2, 0.2), "cylinder"),
        Part((1.25, 0.3, 0.7), (0.025, 0.025, 1.4), plain(0.25, 0.24, 0.22), "cylinder"),
        Part((1.25, 0.3, 1.45), (0.36, 0.36, 0.28), plain(0.88, 0.84, 0.76), "cylinder"),
    ]


def _room_a(rng: np.random.Generator) -> Plan:
    wall = plain(0.86, 0.83, 0.77)
    things = {
        "bookcase": bookcase(-0.95, 0.9, 1.7, plain(0.83, 0.8, 0.75), rng),
        "picture": picture(0.35, 1.35, 0.75, 0.55, grain(0.28, 0.17, 0.1), 1),
        "lamp": lamp(),
    }
    return _shell(-2.6, wall, grain(0.62, 0.43, 0.27, along=1, boards=0.14)), things, (-60, 60, 0.0)


def _room_b(rng: np.random.Generator) -> Plan:
    stripes = checks((0.62, 0.68, 0.6), (0.71, 0.76, 0.68), 0.11, (0,))
    white = plain(0.85, 0.85, 0.84)
    radiator = [Part((0.7 + 0.07 * i, 0.08, 0.45), (0.05, 0.08, 0.58), white) for i in range(13)]
    radiator += [Part((1.12, 0.08, z), (0.9, 0.05, 0.03), white) for z in (0.2, 0.7)]
    brown, brass = grain(0.47, 0.31, 0.25, along=0), plain(0.75, 0.62, 0.3)
    things = {
        "drawers": cabinet((-1.68, 0.01, 0.0), (0.95, 0.45, 0.85), (1, 4), brown, brass),
        "cupboard": cabinet((-0.4, 0.0, 1.2), (0.9, 0.3, 0.6), (2, 1), plain(0.68, 0.73, 0.65), plain(0.3, 0.3, 0.3)),
        "radiator": radiator,
    }
    return _shell(-1.7, stripes, plain(0.46, 0.31, 0.28, noise=0.04)), things, (-34, 68, -0.1)


def _furnished(rng: np.random.Generator) -> Plan:
    """A living room: what stands along its walls, and a table and an armchair before them."""
    cloth, wood, steel = plain(0.42, 0.2, 0.2, noise=0.03), grain(0.42, 0.27, 0.17, along=0), plain(0.3, 0.3, 0.32)
    seat = [(0.0, 0.0, 0.24, 0.62, 0.62, 0.28), (0.0, -0.26, 0.55, 0.62, 0.12, 0.4)]
    seat += [(side * 0.33, 0.0, 0.34, 0.12, 0.62, 0.48) for side in (-1, 1)]
    turn = np.array([[0.87, 0.5, 0], [-0.5, 0.87, 0], [0, 0, 1.0]])
    table = [Part((0.35, 1.25, 0.42), (0.9, 0.55, 0.05), wood)]
    table += [Part((0.35 + x, 1.25 + y, 0.2), (0.05, 0.05, 0.4), wood) for x in (-0.4, 0.4) for y in (-0.22, 0.22)]
    things = {
        "bookcase": bookcase(-1.55, 0.9, 1.7, plain(0.83, 0.8, 0.75), rng),
        "drawers": cabinet((-0.4, 0.01, 0.0), (0.95, 0.45, 0.8), (1, 3), wood, plain(0.75, 0.62, 0.3)),
        "picture": picture(0.1, 1.5, 0.75, 0.55, steel, 1),
        "lamp": lamp(),
        "armchair": [
            Part(
                tuple(np.array([-0.95, 1.15, 0]) + np.array([x, y, 0]) @ turn.T + [0, 0, z]),
                (w, d, h),
                cloth,
                turn=turn,
            )
            for x, y, z, w, d, h in seat
        ],
        "table": table,
        "plant": plant(2.2, 0.5, rng),
    }
    return _shell(-2.6, plain(0.8, 0.8, 0.76), grain(0.62, 0.43, 0.27, along=1, boards=0.14)), things, (-60, 60, 0.0)


def plant(x: float, y: float, rng: np.random.Generator) -> list[Part]:
    parts = [
        Part((x, y, 0.15), (0.3, 0.3, 0.3), plain(0.6, 0.33, 0.22), "cylinder"),
        Part((x, y, 0.5), (0.03, 0.03, 0.45), plain(0.35, 0.25, 0.15), "cylinder"),
    ]
    for _ in range(34):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        axes *= np.sign(np.linalg.det(axes))
        place = np.array([x, y, 0.78]) + rng.normal(0, 1, 3) * [0.12, 0.09, 0.17]
        green = plain(0.2 + 0.1 * rng.random(), 0.4 + 0.15 * rng.random(), 0.18, noise=0.03)
        parts.append(Part(tuple(place), (0.22, 0.1, 0.015), green, "ball", axes))
    return parts


def _room_c(rng: np.random.Generator) -> Plan:
    tilt, turn = np.radians(-12), np.radians(28)
    leaning = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    wall = plain(0.55, 0.6, 0.68, noise=0.02)
    carton = [
        Part((-1.25, 0.42, 0.35), (0.55, 0.45, 0.7), plain(0.66, 0.5, 0.34, noise=0.02), turn=turned),
        Part((-1.25, 0.42, 0.701), (0.06, 0.45, 0.004), plain(0.75, 0.66, 0.5), turn=turned),
    ]
    things = {
        "carton": carton,
        "panel": [Part((-0.1, 0.13, 0.48), (0.7, 0.04, 0.98), plain(0.52, 0.58, 0.66), turn=leaning)],
        "plant": plant(1.15, 0.36, rng),
    }
    floor = checks((0.72, 0.69, 0.65), (0.4, 0.4, 0.42), 0.3)
    return _shell(-1.75, wall, floor), things, (-36, 66, -0.05)


def _humps(
    pitch: float, shape: Callable[[Float64Array, Float64Array], Float64Array], rng: np.random.Generator
) -> Relief:
    """Bodies on a jittered grid: heights and a shade of each place's, by a shape of distance and size in pitches."""
    count = round(3.4 / pitch)
    places = (np.stack(np.meshgrid(*[np.arange(count)] * 2), axis=-1).reshape(-1, 2) + 0.5) * pitch - 1.7
    places += rng.uniform(-0.4, 0.4, places.shape) * pitch
    sizes, shades, tree = rng.uniform(0.6, 1.0, len(places)), rng.uniform(0.55, 1.0, len(places)), cKDTree(places)

    def relief(points: Float64Array) -> tuple[Float64Array, Float64Array]:
        distances, near = tree.query(points, 5)
        heights = pitch * shape(np.asarray(distances) / pitch, sizes[near])
        highest = heights.argmax(axis=1)[:, None]
        return np.take_along_axis(heights, highest, 1)[:, 0], np.take_along_axis(shades[near], highest, 1)[:, 0]

    return relief


def _ground(relief: Relief, *colour: float) -> Part:
    def texture(points: Float64Array) -> Float64Array:
        heights, shades = relief(points[:, :2])
        return np.outer(shades * (0.5 + 0.5 * heights / heights.max()), colour)

    return Part((0, 0, 0), (3.2, 3.2, 0), texture, relief=lambda points: relief(points)[0])


def _on_relief(ground: Part) -> Plan:
    """A carton and a pot on a ground, seen from all around."""
    angle = np.radians(28)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    things = {
        "carton": [Part((-0.35, 0.45, 0.22), (0.4, 0.3, 0.44), plain(0.66, 0.5, 0.34, noise=0.02), turn=turned)],
        "pot": [
            Part((0.4, 0.1, 0.15), (0.3, 0.3, 0.3), plain(0.6, 0.33, 0.22), "cylinder"),
            Part((0.4, 0.1, 0.36), (0.36, 0.36, 0.12), plain(0.5, 0.27, 0.18), "cylinder"),
        ],
    }
    return [ground], things, (-172, 172, 0.0)


def _gravel(rng: np.random.Generator) -> Plan:
    stones = _humps(0.07, lambda far, size: np.asarray(np.sqrt(np.maximum(0.3 * size**2 - far**2, 0))), rng)
    return _on_relief(_ground(stones, 0.68, 0.64, 0.6))


def _lawn(rng: np.random.Generator) -> Plan:
    blades = _humps(0.03, lambda far, size: np.asarray(3 * size * np.maximum(1 - far / 0.8, 0)), rng)
    return _on_relief(_ground(blades, 0.42, 0.62, 0.24))


def _tea_things() -> dict[str, list[Part]]:
    """A large teapot, a mug and a tin about (0, 0.3)."""
    glaze, blue = plain(0.78, 0.75, 0.68), plain(0.2, 0.32, 0.5)
    slanted = np.array([[0.64, 0, 0.77], [0, 1, 0], [-0.77, 0, 0.64]])
    teapot = [
        Part((-0.25, 0.2, 0.29), (0.7, 0.7, 0.58), glaze, "ball"),
        Part((-0.25, 0.2, 0.02), (0.4, 0.4, 0.04), glaze, "cylinder"),
        Part((-0.25, 0.2, 0.61), (0.11, 0.11, 0.11), glaze, "ball"),
        Part((0.17, 0.2, 0.38), (0.1, 0.1, 0.36), glaze, "cylinder", slanted),
        Part((-0.67, 0.2, 0.31), (0.06, 0.06, 0.36), glaze, "cylinder"),
        *(Part((-0.61, 0.2, z), (0.16, 0.06, 0.06), glaze) for z in (0.16, 0.46)),
    ]
    mug = [
        Part((0.5, 0.55, 0.2), (0.34, 0.34, 0.4), blue, "cylinder"),
        Part((0.72, 0.55, 0.2), (0.12, 0.05, 0.22), blue),
    ]
    tin = checks((0.7, 0.2, 0.15), (0.8, 0.72, 0.5), 0.12, (2,))
    return {"teapot": teapot, "mug": mug, "tin": [Part((0.3, -0.3, 0.24), (0.44, 0.3, 0.48), tin)]}


def _glossy(rng: np.random.Generator) -> Plan:
    """Tea things on a dark glossy table, which mirrors them."""
    table = Part((0, 0.3, 0), (2.4, 2.4, 0), plain(0.09, 0.07, 0.06), opacity=0.35)
    return [table, Part((0, 0.3, -0.7), (2.4, 2.4, 0), plain(0.05, 0.04, 0.04))], _tea_things(), (-172, 172, 0.0)


def _turntable(rng: np.random.Generator) -> Plan:
    """Tea things on a disc that turns before a camera that does not, in a room with pictures on its walls."""
    disc = Part((0, 0.3, -0.01), (2.2, 2.2, 0.02), plain(0.55, 0.53, 0.5), "cylinder")
    floor = Part((0, 0.3, -0.5), (7, 7, 0), grain(0.4, 0.3, 0.22, boards=0.2))
    walls = [Part((x, 0.3, 0.9), (0, 7, 2.8), painting(abs(x) > 0)) for x in (-3.5, 3.5)]
    walls += [Part((0, y, 0.9), (7, 0, 2.8), painting(2)) for y in (-3.2, 3.8)]
    return [disc, floor, *walls], _tea_things(), (-172, 172, 0.0)


ROOMS: dict[str, Callable[[np.random.Generator], Plan]] = {
    "a": _room_a,
    "b": _room_b,
    "c": _room_c,
    "furnished": _furnished,
    "gravel": _gravel,
    "lawn": _lawn,
    "glossy": _glossy,
    "turntable": _turntable,
}
