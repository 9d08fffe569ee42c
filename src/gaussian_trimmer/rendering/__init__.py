"""Draw Gaussians as the original implementation does: EWA splatting, front to back by centre depth, on the CPU."""

from gaussian_trimmer.rendering.blending import Rendering as Rendering
from gaussian_trimmer.rendering.tile_renderer import blend_values as blend_values
from gaussian_trimmer.rendering.tile_renderer import blend_weights as blend_weights
from gaussian_trimmer.rendering.tile_renderer import render as render
from gaussian_trimmer.rendering.tile_renderer import top_contributors as top_contributors
