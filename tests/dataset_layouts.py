"""Small folders in the layouts of published data sets, made of the ball of `toy`, with the traps of the real ones."""

import cv2
import numpy as np
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

SIZE = 96


def save_capture(folder, names, selection_name="selection.npy"):
    """`scene.ply`, cameras of the named pictures and the rough selection; returns cameras, masks and pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    scene, truth = toy.ball_on_floor()
    formats.write(scene, folder / "scene.ply")
    cameras, _ = plan_cameras(scene.select(truth), toy.UP, PlanConfig(size=SIZE, views=len(names)))
    toy.save_cameras(folder / "cameras.json", cameras, names)
    if selection_name:
        np.save(folder / selection_name, toy.dilated(scene, truth))
    masks, pictures = {}, {}
    for name, camera in zip(names, cameras, strict=True):
        share = blend_values(scene, camera, truth[:, None].astype(np.float32))[..., 0]
        masks[name] = np.where(share > 0.5, np.uint8(255), np.uint8(0))
        pictures[name] = (255 * np.clip(render(scene, camera).rgb[..., ::-1], 0, 1)).astype("u1")
    return masks, pictures


def write(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)


def save_nvos(root, predictions):
    """Two tasks on one scene and one on another; one mask is a JPEG, one is larger than its camera's picture.

    The targets are the third pictures; the masks of the first pictures, which those who take test picture 0 would
    compare with, would be others.
    """
    names = ["DJI_0001.png", "DJI_0002.png", "DJI_0003.png"]
    masks, pictures = save_capture(predictions / "horns", names, "horns_center.npy")
    scene, truth = toy.ball_on_floor()
    half = truth & (scene.means[:, 0] > 0)
    np.save(predictions / "horns" / "horns_left.npy", half)
    write(root / "masks" / "horns_center" / "DJI_0003_mask.jpg", masks["DJI_0003.png"])
    write(root / "masks" / "horns_center" / "DJI_0003.png", pictures["DJI_0003.png"])
    write(root / "masks" / "horns_left" / "DJI_0002_mask.png", masks["DJI_0002.png"])
    names = ["IMG_1.JPG", "IMG_2.JPG", "IMG_4027.JPG"]
    masks, _ = save_capture(predictions / "fern", names)
    large = cv2.resize(masks["IMG_4027.JPG"], (3 * SIZE, 3 * SIZE), interpolation=cv2.INTER_NEAREST)
    write(root / "masks" / "fern" / "IMG_4027_mask.png", large)


def save_lerf_mask(root, predictions):
    """One scene with two objects; the folders of masks are numbers of test pictures."""
    names = [f"frame_{i:05d}.jpg" for i in range(5)]
    masks, pictures = save_capture(predictions / "figurines", names, "red ball.npy")
    for i, name in enumerate(names):
        write(root / "figurines" / "images" / name, pictures[name])
        if i not in (1, 3):
            write(root / "figurines" / "images_train" / name, pictures[name])
    for number, name in enumerate((names[1], names[3])):
        write(root / "figurines" / "test_mask" / str(number) / "red ball.png", masks[name])
    write(root / "figurines" / "test_mask" / "0" / "ball's rim.png", masks[names[1]])
    np.save(predictions / "figurines" / "ball's rim.npy", np.load(predictions / "figurines" / "red ball.npy"))
