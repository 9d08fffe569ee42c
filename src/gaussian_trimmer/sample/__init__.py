"""The sample scene that `gaussian-trimmer demo` and the examples trim; its licence is CC0, see LICENSE.txt."""

from pathlib import Path

_FOLDER = Path(__file__).parent

SCENE = _FOLDER / "scene.ply"
"""A table with a toy lighthouse, a robot, a mug and a fern: 59,472 Gaussians, SH degree 1, up +z, metres."""
CAMERAS = _FOLDER / "cameras.json"
"""The cameras that the scene was trained with."""
SELECTION = _FOLDER / "lighthouse_rough.npy"
"""The lighthouse, roughly, with table around its foot: bool (N,)."""
MASKS = _FOLDER / "masks"
"""Masks of the lighthouse in ten of the cameras' pictures, coverage 0..255."""
