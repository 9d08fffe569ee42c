"""Bodies and grounds by points on their surfaces, and textures for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gaussian_trimmer.gaussians import Float64Array

RELIEF_SPACING = 0.5
"""Of a ground with relief, relative to that of others, since its slopes are steep."""

MIRRORED_LIGHT = 0.7

Texture = Callable[[Float64Array], Float64Array]
"""Colours (n, 3) of points (n, 3)."""


@dataclass(frozen=True, eq=False)
class Part:
    """A body about a centre."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    """Full extents along its own axes."""
    texture: Texture
    shape: str = "box"
    """box, ball, or cylinder (along its z)."""
    turn: Float64Array = field(default_factory=lambda: np.eye(3))
    """Rotation from its own axes to the world's."""
    relief: Callable[[Float64Array], Float64Array] | None = None
    """Heights (n,) of a ground at positions (n, 2), in place of a shape."""
    opacity: float = 0.95

    def sample(self, spacing: float, rng: np.random.Generator) -> tuple[Float64Array, Float64Array]:
        """Points of the surface about evenly `spacing` apart, and their normals, (n, 3) each."""
        if self.relief is not None:
            return _heightfield(self.size[0], self.size[1], spacing * RELIEF_SPACING, self.relief)
        local, normals = {"box": _box, "ball": _ball, "cylinder": _cylinder}[self.shape](np.array(self.size), spacing)
        local = local + rng.normal(0, 0.1 * spacing, local.shape) * (1 - abs(normals))
        return local @ self.turn.T + self.centre, normals @ self.turn.T

    def distance(self, points: Float64Array) -> Float64Array:
        """Distances of points from the box around it, (n,)."""
        local = (points - self.centre) @ self.turn
        return np.asarray(np.linalg.norm(np.maximum(abs(local) - np.array(self.size) / 2, 0), axis=1))


def mirrored(part: Part) -> Part:
    """What a glossy surface z = 0 shows of a body: itself upside down, darker."""
    down = np.array([1.0, 1.0, -1.0])
    x, y, z = part.centre
    turn = down[:, None] * part.turn * down
    return replace(
        part, centre=(x, y, -z), turn=turn, texture=lambda points: MIRRORED_LIGHT * part.texture(points * down)
    )


def _grid(width: float, height: float, spacing: float) -> Float64Array:
    """Points of a rectangle about its centre, (n, 2)."""
    sides = [max(1, round(length / spacing)) for length in (width, height)]
    u, v = ((np.arange(n) + 0.5) / n - 0.5 for n in sides)
    return np.stack(np.meshgrid(u * width, v * height), axis=-1).reshape(-1, 2)


def _heightfield(
    width: float, depth: float, spacing: float, relief: Callable[[Float64Array], Float64Array]
) -> tuple[Float64Array, Float64Array]:
    places, step = _grid(width, depth, spacing), spacing / 2
    slopes = [(relief(places + side) - relief(places - side)) / (2 * step) for side in np.eye(2) * step]
    normals = np.column_stack([-slopes[0], -slopes[1], np.ones(len(places))])
    return np.column_stack([places, relief(places)]), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _box(size: Float64Array, spacing: float) -> tuple[Float64Array, Float64Array]:
    points, normals = [], []
    for axis in range(3):
        if size[axis] > 0 and not size[[a for a in range(3) if a != axis]].all():
            continue  # the sides of a rectangle
        others = [a for a in range(3) if a != axis]
        flat = _grid(size[others[0]], size[others[1]], spacing)
        for side in (-1, 1) if size[axis] > 0 else (1,):
            where = np.zeros((len(flat), 3))
            where[:, others] = flat
            where[:, axis] = side * size[axis] / 2
            points.append(where)
            normals.append(np.tile(side * np.eye(3)[axis], (len(flat), 1)))
    return np.concatenate(points), np.concatenate(normals)


def _ball(size: Float64Array, spacing: float) -> tuple[Float64Array, Float64Array]:
    n = max(12, int(np.pi * np.sum(size[[0, 1, 2]] * size[[1, 2, 0]]) / 3 / spacing**2))
    z = 1 - 2 * (np.arange(n) + 0.5) / n
    angle = np.pi * (1 + 5**0.5) * np.arange(n)
    unit = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    normals = unit / size
    return unit * size / 2, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _cylinder(size: Float64Array, spacing: float) -> tuple[Float64Array, Float64Array]:
    flat = _grid(np.pi * size[0], size[2], spacing)
    angle = 2 * flat[:, 0] / size[0]
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(flat))], axis=1)
    side = normals * [size[0] / 2, size[1] / 2, 0] + flat[:, 1:] * [[0, 0, 1]]
    lid = _grid(size[0], size[1], spacing)
    lid = lid[np.sum((2 * lid / size[:2]) ** 2, axis=1) < 1]
    lids = [np.column_stack([lid, np.full(len(lid), end * size[2] / 2)]) for end in (-1, 1)]
    ends = [np.tile([0.0, 0, end], (len(lid), 1)) for end in (-1, 1)]
    return np.concatenate([side, *lids]), np.concatenate([normals, *ends])


def plain(*colour: float, noise: float = 0.015) -> Texture:
    """One colour with fine noise and faint clouds, as plaster."""

    def texture(points: Float64Array) -> Float64Array:
        grain = np.random.default_rng(0).normal(0, noise, (len(points), 1))
        return np.array(colour) + grain + noise * clouds(points, 0.4, 1)

    return texture


def grain(*colour: float, along: int = 2, boards: float = 0.0, across: int = 0) -> Texture:
    """Wood with its grain along an axis, in boards of some width if that is given, with dark joints."""

    def texture(points: Float64Array) -> Float64Array:
        stretched = points.copy()
        stretched[:, along] *= 0.08
        tone = 1 + 0.10 * clouds(stretched, 0.03, 2)
        if boards:
            board = np.floor(points[:, across] / boards)
            tone = tone * (1 + 0.12 * np.sin(board * 12.9898))[:, None]
            tone = np.where((points[:, across] / boards - board < 0.06)[:, None], 0.6 * tone, tone)
        return np.array(colour) * tone

    return texture


def checks(first: Sequence[float], second: Sequence[float], width: float, axes: tuple[int, ...] = (0, 1)) -> Texture:
    """Two colours in turn: tiles along two axes, stripes along one."""

    def texture(points: Float64Array) -> Float64Array:
        odd = np.floor(points[:, axes] / width + 1e-6).sum(axis=1) % 2 == 1
        return np.where(odd[:, None], np.array(first), np.array(second)) + 0.02 * clouds(points, 0.05, 3)

    return texture


def painting(seed: int) -> Texture:
    """Smooth patches of colours."""
    return lambda points: 0.5 + 0.22 * np.concatenate([clouds(points, 0.22, 3 * seed + i) for i in range(3)], axis=1)


def clouds(points: Float64Array, length: float, seed: int) -> Float64Array:
    """Smooth noise with details of some length and standard deviation one, (n, 1)."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(0, 1 / length, (3, 24)), rng.uniform(0, 2 * np.pi, 24)
    return np.asarray(np.cos(points @ waves + phases).sum(axis=1, keepdims=True) / np.sqrt(12))
