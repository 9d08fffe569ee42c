"""A room whose surfaces and things are made of Gaussians of known labels, and the cameras that see it."""

from dataclasses import replace

import numpy as np
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.gaussians import Gaussians, concatenate, quaternions_of

SPACING = 0.05
RED, GREEN, BLUE, GREY, WOOD = (0.8, 0.1, 0.1), (0.1, 0.6, 0.2), (0.2, 0.3, 0.8), (0.7, 0.7, 0.68), (0.55, 0.35, 0.2)


def sheet(corner, first, second, colour, seed=0):
    """Flat Gaussians that cover the parallelogram of two sides."""
    corner, first, second = (np.asarray(side, float) for side in (corner, first, second))
    rng = np.random.default_rng(seed)
    u, v = (np.arange(0.5, max(1, round(np.linalg.norm(side) / SPACING))) for side in (first, second))
    grid = np.stack(np.meshgrid(u / len(u), v / len(v), indexing="ij"), -1).reshape(-1, 2)
    grid += rng.uniform(-0.1, 0.1, grid.shape) / [len(u), len(v)]
    means = corner + grid @ np.stack([first, second])
    a, b = first / np.linalg.norm(first), second / np.linalg.norm(second)
    turned = quaternions_of(np.stack([a, b, np.cross(a, b)], axis=1)[None])
    scales = (0.6 * SPACING, 0.6 * SPACING, 0.05 * SPACING)
    made = toy.gaussians(means, scales, np.asarray(colour) + rng.normal(0, 0.02, (len(means), 3)))
    return made.replace(quaternions=np.tile(turned, (len(made), 1)))


def box(middle, size, colour, seed=0, sides=4):
    """The top and so many sides of a box whose foot has a middle (x, y) on the floor; the last one faces -y."""
    (x, y), (length, width, height) = middle, size
    low = np.array([x - length / 2, y - width / 2, 0])
    across, along, up = np.diag([length, width, height]).astype(float)
    made = [
        sheet(low + up, across, along, colour, seed),
        sheet(low + along, across, up, colour, seed + 2),
        sheet(low, along, up, colour, seed + 3),
        sheet(low + across, along, up, colour, seed + 4),
        sheet(low, across, up, colour, seed + 1),
    ]
    return concatenate(made[: sides + 1])


def ball(middle, radius, colour, seed=0):
    """The surface of a ball on the floor."""
    rng = np.random.default_rng(seed)
    count = int(4 * np.pi * radius**2 / SPACING**2)
    steps = np.arange(count) + 0.5
    height, turn = 1 - 2 * steps / count, np.pi * (1 + 5**0.5) * steps
    ring = np.sqrt(1 - height**2)
    outward = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    return toy.gaussians(
        np.array([*middle, radius]) + radius * outward, [0.4 * SPACING] * 3, colour + rng.normal(0, 0.02, (count, 3))
    )


def floor(side=6.0):
    return sheet((-side / 2, -side / 2, 0), (side, 0, 0), (0, side, 0), WOOD, 90)


def wall(side=6.0, height=3.0):
    return sheet((-side / 2, -side / 2, 0), (0, side, 0), (0, 0, height), GREY, 91)


def scene_of(*parts):
    """The parts as one scene, and the number of the part that each Gaussian is of, (N,), from 0."""
    return concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])


def cameras(count=10, distance=5.0, height=2.5):
    """A ring of cameras on the open side of the room."""
    turns = np.linspace(-0.4 * np.pi, 0.4 * np.pi, count)
    placed = [
        toy.camera_at((distance * np.cos(turn), distance * np.sin(turn), height), (0, 0, 0.4), 240) for turn in turns
    ]
    return CameraSet(tuple(placed), toy.UP, (True,) * count, False)


def save(scene: Gaussians, seen: CameraSet, folder):
    """The scene as scene.ply and its cameras as cameras.json in a folder."""
    formats.write(scene, folder / "scene.ply")
    toy.save_cameras(folder / "cameras.json", seen.cameras)


def moved(scene: Gaussians, seen: CameraSet, rotation, scale, shift):
    """The scene and its cameras, turned, scaled and shifted."""
    placed = []
    for camera in seen.cameras:
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation @ rotation.T
        pose[:3, 3] = -pose[:3, :3] @ (scale * rotation @ camera.centre + shift)
        placed.append(replace(camera, world_to_camera=pose))
    return toy.moved(scene, rotation, scale, shift), CameraSet(tuple(placed), rotation @ seen.up, seen.train, False)
