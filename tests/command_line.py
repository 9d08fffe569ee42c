"""Runs of the command line on the ball of `toy`, saved as files."""

import numpy as np
import toy
from dataset_layouts import save_capture, write

from gaussian_trimmer.cli import main

SMALL = ["--set", "plan.size=160", "--set", "refine=off"]


def save_ball(folder):
    """`scene.ply`, `rough.npy`, and `cameras.json` with masks of four of its five pictures in `masks/`."""
    masks, _ = save_capture(folder, [f"{i}.png" for i in range(5)], "rough.npy")
    for name in list(masks)[:4]:
        write(folder / "masks" / name, masks[name])
    return toy.ball_on_floor()


def within(path, scene, centre, radius):
    """A selection file of what lies within a ball."""
    np.save(path, np.linalg.norm(scene.means - np.array(centre), axis=1) <= radius)
    return path


def run(*arguments):
    """Exit code of a command, whichever way it ends."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as end:
        return end.code
