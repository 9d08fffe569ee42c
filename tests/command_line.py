"""Runs of the command line on the ball of `toy`, saved as files."""

import cv2
import numpy as np
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.cli import main
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

SMALL = ["--set", "plan.size=160", "--set", "refine=off"]


def save_ball(folder):
    """`scene.ply`, `rough.npy`, and `cameras.json` with masks of four of its five pictures in `masks/`."""
    scene, truth = toy.ball_on_floor()
    formats.write(scene, folder / "scene.ply")
    np.save(folder / "rough.npy", toy.dilated(scene, truth))
    cameras, _ = plan_cameras(scene.select(truth), toy.UP, PlanConfig(size=96))
    toy.save_cameras(folder / "cameras.json", cameras)
    (folder / "masks").mkdir()
    for i, camera in enumerate(cameras[:4]):
        share = blend_values(scene, camera, truth[:, None].astype(np.float32))[..., 0]
        assert cv2.imwrite(str(folder / "masks" / f"{i}.png"), (255 * share).astype(np.uint8))
    return scene, truth


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
