"""The convex hull of an object as a mesh, for collisions in engines and simulators."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, Gaussians, IntArray, ellipsoid_points

_CORNERS = 128
"""Directions in which the farthest point is a corner: engines take hulls of a few hundred corners at most."""


def convex_hull(gaussians: Gaussians) -> tuple[Float64Array, IntArray]:
    """Return corners (C, 3) of a hull around one standard deviation of Gaussians, and its triangles (F, 3), from 0.

    Triangles are counter-clockwise as seen from outside. What is flat gets a hull that is hardly thicker.
    """
    from scipy.spatial import ConvexHull

    points = ellipsoid_points(gaussians).reshape(-1, 3)
    height = 1 - (2 * np.arange(_CORNERS) + 1) / _CORNERS
    turn, side = np.pi * (1 + 5**0.5) * np.arange(_CORNERS), np.sqrt(1 - height**2)
    directions = np.stack([side * np.cos(turn), side * np.sin(turn), height], axis=1)
    corners = points[np.unique([int(np.argmax(points @ direction)) for direction in directions])]
    hull = ConvexHull(corners, qhull_options="QJ")  # joggled: what is flat has a hull, too
    a, b, c = corners[hull.simplices].swapaxes(0, 1)
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    return corners, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)


def hull_as_obj(gaussians: Gaussians) -> str:
    """Return the hull of Gaussians as the text of an .obj file, in their own coordinates."""
    corners, triangles = convex_hull(gaussians)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in corners]
    return "\n".join([*lines, *(f"f {i} {j} {k}" for i, j, k in triangles + 1), ""])
