"""Trim with a renderer of your own: any object with the methods of `rendering.Renderer` will do.

This one inherits the built-in renderer and takes the gloss off its pictures: colours that change with the direction of
view mislead GrabCut, which goes by colour.
"""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.rendering.numba_cpu import NumbaRenderer


class MatteRenderer(NumbaRenderer):
    name = "matte"

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        matte = gaussians.replace(sh_rest=gaussians.sh_rest[:, :, :0])
        return super().render(matte, camera, background, weights)


scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
for renderer in ("numba", MatteRenderer()):
    result = gt.trim(scene, rough, up="z", renderer=renderer, segmenter="grabcut")
    colours = np.stack([seen.view.rgb for seen in result.views])
    unexpected = np.mean([np.mean(seen.mask != (seen.view.object_prior > 0.5)) for seen in result.views])
    print(
        f"{result.renderer}: {result.object_mask.sum()} Gaussians kept, masks unexpected in {unexpected:.2%} of the "
        f"pixels, mean colour {colours.mean():.4f}, brightest {colours.max():.2f}"
    )
