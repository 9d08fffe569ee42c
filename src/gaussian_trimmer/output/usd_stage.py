"""A USD stage, as text, of files of splats: where each lies, and an object's label and collider.

USD knows splats as ParticleField3DGaussianSplat since 26.03. Converters write that from a PLY, so that the stage refers
to the files that they make, `object.usdc` of `object.ply`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from gaussian_trimmer.gaussians import Float64Array, IntArray

_STAGE = """#usda 1.0
(
    defaultPrim = "scene"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "scene"
{{
{parts}
}}
"""
_BACKGROUND = """    def "background" (
        prepend references = {file}
    )
    {{
    }}"""
_OBJECT = """    def Xform "object_{id}" (
        displayName = {name}
        prepend apiSchemas = ["SemanticsLabelsAPI:class"]
    )
    {{
        token[] semantics:labels:class = [{name}]
        matrix4d xformOp:transform = {matrix}
        uniform token[] xformOpOrder = ["xformOp:transform"]

        def "splats" (
            prepend references = {file}
        )
        {{
        }}

        def Mesh "collider" (
            prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]
        )
        {{
            point3f[] points = {points}
            int[] faceVertexCounts = {counts}
            int[] faceVertexIndices = {indices}
            uniform token physics:approximation = "convexHull"
            uniform token purpose = "guide"
            uniform token subdivisionScheme = "none"
        }}
    }}"""


def stage_of(parts: Iterable[str]) -> str:
    """Return the text of a stage in which up is +z, of what `object_in_stage` and `background_in_stage` return."""
    return _STAGE.format(parts="\n".join(parts))


def object_in_stage(
    number: int, name: str, file: str, matrix: Float64Array, corners: Float64Array, triangles: IntArray
) -> str:
    """Return an object of a stage.

    Args:
        number: its id.
        name: its label.
        file: name of its file of splats.
        matrix: takes points of the file to the stage, (4, 4).
        corners: those of its convex hull in the file, (C, 3).
        triangles: three of them each, (F, 3).
    """
    return _OBJECT.format(
        id=number,
        name=json.dumps(name, ensure_ascii=False),
        matrix=tuple(tuple(column) for column in matrix.T.tolist()),  # USD multiplies rows by matrices
        file=_converted(file),
        points=[tuple(float(f"{value:.7g}") for value in corner) for corner in corners],
        counts=[3] * len(triangles),
        indices=triangles.ravel().tolist(),
    )


def background_in_stage(file: str) -> str:
    """Return the scene without the objects, whose file has the stage's coordinates."""
    return _BACKGROUND.format(file=_converted(file))


def _converted(file: str) -> str:
    return f"@./{Path(file).stem}.usdc@"
