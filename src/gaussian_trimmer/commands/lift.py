"""`gaussian-trimmer lift`: a coarse selection from masks of posed pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.console import open_console, refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.whole import whole_file
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.lifting import lift_by_assignment, lift_by_vote, lift_objects_by_assignment
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmenters.mask_files import cameras_with_masks, ids_of, mask_of


@dataclass(frozen=True)
class Lift:
    """Make a coarse selection from masks of the training pictures.

    A mask belongs to the picture of its name: IMG_7.png or IMG_7.JPG.png to IMG_7.JPG. Pictures without a mask are
    passed over.
    """

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder of masks; bright is the object."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the masks' pictures: a COLMAP folder, transforms.json or cameras.json."""
    output: Annotated[Path, arg(metavar="FILE")] = Path("selection.npy")
    """The selection, an .npy file of booleans, or of object numbers with --object-ids."""
    method: Literal["assignment", "vote"] = "assignment"
    """By what a Gaussian is judged: the pixels that it paints, or where its centre is."""
    gamma: float = 0.0
    """For `assignment`: bias towards the background, -1 to 1."""
    threshold: float = 0.7
    """For `vote`: share of the masks that a centre must exceed."""
    object_ids: bool = False
    """The masks are images of object numbers, 0 for the background; all objects are lifted at once."""
    renderer: Annotated[str, arg(metavar="{auto,numba,reference,gsplat}")] = "auto"
    """What renders the views."""
    overwrite: bool = False
    """Replace the output if it exists."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Lift the masks and save the selection.

        Raises:
            InputError: something that the user gave cannot be used, or the selection is empty.
        """
        if self.output.suffix != ".npy":
            raise InputError(f"The selection '{self.output}' is saved as .npy; give a name with that ending.")
        if self.object_ids and self.method == "vote":
            raise InputError("Images of object numbers are lifted by 'assignment' alone; leave --method out.")
        refuse_existing(self.output, overwrite=self.overwrite)
        scene = formats.read(self.scene)
        cameras = cameras_with_masks(read_camera_set(self.cameras).pinhole_cameras(), self.masks)
        lifted = self._lift(scene, cameras)
        if not lifted.any():
            raise InputError("No Gaussian was lifted; check that the cameras and masks belong to this scene.")
        with whole_file(self.output) as part, part.open("wb") as file:
            np.save(file, lifted, allow_pickle=False)
        console = open_console(quiet=self.quiet)
        console.print(f"{self.output}: {np.count_nonzero(lifted):,} of {len(scene):,} Gaussians, {len(cameras)} masks")
        choice = " --selection.object-id ID" if self.object_ids else ""
        console.print(f"Now: gaussian-trimmer trim {self.scene} {self.output} --cameras {self.cameras}{choice}")

    def _lift(self, scene: Gaussians, cameras: list[Camera]) -> NDArray[Any]:
        if self.object_ids:
            labels = [ids_of(camera, self.masks) for camera in cameras]
            return lift_objects_by_assignment(scene, cameras, labels, get_renderer(self.renderer), self.gamma)
        masks = [mask_of(camera, self.masks) for camera in cameras]
        if self.method == "vote":
            return lift_by_vote(scene, cameras, masks, self.threshold)
        return lift_by_assignment(scene, cameras, masks, get_renderer(self.renderer), self.gamma)
