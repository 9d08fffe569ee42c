"""GaussianTrimmer: sharp object boundaries for segmentations of 3D Gaussian Splatting scenes.

    import gaussian_trimmer as gt

    scene = gt.read("scene.ply")
    rough = gt.read_selection("rough.npy", scene)
    result = gt.trim(scene, rough, cameras=gt.read_cameras("sparse/0"))
    result.object_mask  # (N,) over the scene's rows
    gt.save(result, "trimmed")

What is named here is loaded when it is first used, so that importing the package takes no time.
"""

from __future__ import annotations

from gaussian_trimmer._version import __version__

TYPE_CHECKING = False
if TYPE_CHECKING:  # `typing` takes longer to import than all that is imported here
    from typing import Any

    from gaussian_trimmer.camera_files import cameras_from_arrays
    from gaussian_trimmer.camera_files import read_camera_set as read_cameras
    from gaussian_trimmer.errors import InputError
    from gaussian_trimmer.finding.find import find_objects
    from gaussian_trimmer.finding.found import chosen_objects
    from gaussian_trimmer.formats import read, write
    from gaussian_trimmer.gaussians import Gaussians
    from gaussian_trimmer.output.report import describe
    from gaussian_trimmer.output.saving import save
    from gaussian_trimmer.selecting import marks
    from gaussian_trimmer.selecting.marks import read_marks
    from gaussian_trimmer.selecting.select import select
    from gaussian_trimmer.selecting.selection import read_selection
    from gaussian_trimmer.trimming.config import TrimConfig
    from gaussian_trimmer.trimming.result import TrimResult
    from gaussian_trimmer.trimming.trim import trim, trim_objects


__all__ = [
    "Gaussians",
    "InputError",
    "TrimConfig",
    "TrimResult",
    "__version__",
    "cameras_from_arrays",
    "chosen_objects",
    "describe",
    "find_objects",
    "marks",
    "read",
    "read_cameras",
    "read_marks",
    "read_selection",
    "save",
    "select",
    "trim",
    "trim_objects",
    "write",
]

_LATE = {
    "Gaussians": "gaussian_trimmer.gaussians:Gaussians",
    "InputError": "gaussian_trimmer.errors:InputError",
    "TrimConfig": "gaussian_trimmer.trimming.config:TrimConfig",
    "TrimResult": "gaussian_trimmer.trimming.result:TrimResult",
    "cameras_from_arrays": "gaussian_trimmer.camera_files:cameras_from_arrays",
    "chosen_objects": "gaussian_trimmer.finding.found:chosen_objects",
    "describe": "gaussian_trimmer.output.report:describe",
    "find_objects": "gaussian_trimmer.finding.find:find_objects",
    "marks": "gaussian_trimmer.selecting.marks",
    "read": "gaussian_trimmer.formats:read",
    "read_cameras": "gaussian_trimmer.camera_files:read_camera_set",
    "read_marks": "gaussian_trimmer.selecting.marks:read_marks",
    "read_selection": "gaussian_trimmer.selecting.selection:read_selection",
    "save": "gaussian_trimmer.output.saving:save",
    "select": "gaussian_trimmer.selecting.select:select",
    "trim": "gaussian_trimmer.trimming.trim:trim",
    "trim_objects": "gaussian_trimmer.trimming.trim:trim_objects",
    "write": "gaussian_trimmer.formats:write",
}
"""Where each is defined, as module or as module:attribute."""


def __getattr__(name: str) -> Any:
    if name not in _LATE:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    module, _, attribute = _LATE[name].partition(":")
    value = import_module(module)
    globals()[name] = value = getattr(value, attribute) if attribute else value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
