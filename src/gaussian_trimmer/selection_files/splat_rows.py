"""The rows of a splat file as named columns, so that files with different attributes can be compared."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import finite_log_scales, finite_opacity_logits
from gaussian_trimmer.formats.ply_table import read_columns, read_header
from gaussian_trimmer.gaussians import FloatArray, Gaussians

Columns = Mapping[str, NDArray[Any]]
"""Columns by name, each (M,). Spherical harmonics above degree 0 are `sh_<coefficient>_<channel>` in attributes."""

_ATTRIBUTE = re.compile(r"[xyz]|f_dc_[012]|opacity|scale_[012]|rot_[0123]|sh_\d+_[012]")


@dataclass(frozen=True, eq=False)
class SplatRows:
    """The M rows of a splat file that serves as a selection."""

    attributes: Columns
    """What the renderer knows, by which rows are matched with those of the scene."""
    columns: Columns
    """Everything that the file holds, by the file's names."""

    def __len__(self) -> int:
        return len(self.attributes["x"])


def read_splat_rows(path: Path) -> SplatRows:
    """Return rows of a PLY with at least x, y and z, or of any other splat file.

    Raises:
        InputError: the file cannot be read, or has no positions.
    """
    if path.suffix.lower() == ".ply":
        header = read_header(path)
        vertices = (element for element in header.elements if element.name == "vertex")
        if any(name == "x" for element in vertices for name, _ in element.properties):
            columns = read_columns(path, header)
            if missing := {"y", "z"} - columns.keys():
                raise InputError(f"'{path}' has no property {min(missing)}, so its rows cannot be told apart.")
            return SplatRows(_attributes(columns), columns)
    gaussians = formats.read(path)
    attributes = gaussian_columns(gaussians)
    return SplatRows(attributes, {**attributes, **gaussians.extras})


def gaussian_columns(gaussians: Gaussians) -> dict[str, NDArray[Any]]:
    """Return the attributes of Gaussians as named columns, each a view (N,)."""
    columns = {"xyz"[i]: gaussians.means[:, i] for i in range(3)}
    columns |= {f"f_dc_{i}": gaussians.sh_dc[:, i] for i in range(3)}
    columns |= {"opacity": gaussians.opacity_logits}
    columns |= {f"scale_{i}": gaussians.log_scales[:, i] for i in range(3)}
    columns |= {f"rot_{i}": gaussians.quaternions[:, i] for i in range(4)}
    _, channels, coefficients = gaussians.sh_rest.shape
    columns |= {f"sh_{k}_{c}": gaussians.sh_rest[:, c, k] for k in range(coefficients) for c in range(channels)}
    return columns


def has_identity_features(columns: Container[str]) -> bool:
    """Return whether the columns are those of a method that adds identity features."""
    return "obj_dc_0" in columns


def identity_features(columns: Columns) -> FloatArray | None:
    """Return the columns obj_dc_0, obj_dc_1, ... side by side, (M, D), or None if there are none."""
    if not has_identity_features(columns):
        return None
    names = takewhile(columns.__contains__, (f"obj_dc_{i}" for i in count()))
    return np.column_stack([np.asarray(columns[name], np.float32) for name in names])


def _attributes(columns: Columns) -> dict[str, NDArray[Any]]:
    """Return the attributes among PLY columns; f_rest is channel-major, so its numbering depends on the degree."""
    renamed = dict(columns)
    n_rest = sum(name.startswith("f_rest_") for name in columns)
    if n_rest % 3 == 0 and all(f"f_rest_{i}" in columns for i in range(n_rest)):
        per_channel = n_rest // 3
        renamed |= {f"sh_{i % per_channel}_{i // per_channel}": columns[f"f_rest_{i}"] for i in range(n_rest)}
    attributes = {name: column for name, column in renamed.items() if _ATTRIBUTE.fullmatch(name)}
    # What has no finite value in the file has one in the scene that was read from such a file.
    for name in attributes.keys() & {"opacity", "scale_0", "scale_1", "scale_2"}:
        values = np.asarray(attributes[name], np.float32)
        attributes[name] = finite_opacity_logits(values) if name == "opacity" else finite_log_scales(values)
    return attributes
