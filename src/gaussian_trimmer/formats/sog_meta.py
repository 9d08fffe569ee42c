"""The meta.json of a SOG file: what the bytes of its textures mean.

Version 2 looks bytes up in codebooks, version 1 spreads them evenly between a least and a greatest value; both become
tables of 256 values here.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.packing import from_levels, opacity_logits_of
from gaussian_trimmer.gaussians import Float64Array, FloatArray

_FILES = {"means": 2, "scales": 1, "quats": 1, "sh0": 1, "shN": 2}
"""How many textures each attribute has."""


@dataclass(frozen=True, eq=False)
class SogMeta:
    """What meta.json says, checked."""

    count: int
    mins: Float64Array
    """Least centre, as sign(x) log(1 + |x|), (3,)."""
    maxs: Float64Array
    """Greatest centre, (3,)."""
    scales: FloatArray
    """Log scales by byte and axis, (256, 3)."""
    colours: FloatArray
    """Degree-0 coefficients by byte and channel, (256, 3)."""
    opacity_logits: FloatArray
    """Opacity logits by byte, (256,)."""
    sh: FloatArray | None
    """Coefficients of degrees 1 to 3 by byte, (256,), where there are any."""
    files: dict[str, list[str]]
    """Names of the textures by attribute: means, scales, quats, sh0, shN."""


def parse_meta(data: bytes, path: Path) -> SogMeta:
    """Return what the meta.json of a SOG file of version 1 or 2 says.

    Raises:
        InputError: it is not that of a SOG.
    """
    try:
        meta = json.loads(data)
        version = meta.get("version", 1)
        if version not in (1, 2):
            raise ValueError(f"it is of version {version}; versions 1 and 2 can be read")
        files = {name: meta[name]["files"] for name in _FILES if name != "shN" or meta.get("shN")}
        for name, names in files.items():
            if len(names) != _FILES[name] or not all(isinstance(file, str) for file in names):
                raise ValueError(f"{name} has not the names of {_FILES[name]} files")
        mins, maxs = (np.array(meta["means"][end], np.float64).reshape(3) for end in ("mins", "maxs"))
        count = int(meta["count"] if version == 2 else meta["means"]["shape"][0])
        tables = _tables(meta)
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(
            f"'{path}' is damaged: its meta.json is not that of a SOG, {clip_name(str(error))}."
        ) from error
    return SogMeta(count, mins, maxs, *tables, files)


def _tables(meta: dict[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Tables of log scales, colours, opacity logits and coefficients."""
    sh = meta.get("shN")
    if meta.get("version", 1) == 1:
        colours = _range(meta["sh0"], 4)
        return _range(meta["scales"], 3), colours[:, :3], colours[:, 3], _range(sh, 1)[:, 0] if sh else None
    scales, colours = (np.repeat(_codebook(meta[name])[:, None], 3, axis=1) for name in ("scales", "sh0"))
    return scales, colours, opacity_logits_of(np.arange(256, dtype=np.uint8)), _codebook(sh) if sh else None


def _range(entry: dict[str, Any], width: int) -> FloatArray:
    """Return the values (256, width) that bytes of version 1 mean."""
    low, high = (np.array(entry[end], np.float64).reshape(width) for end in ("mins", "maxs"))
    return from_levels(np.arange(256)[:, None], low, high, 8).astype(np.float32)


def _codebook(entry: dict[str, Any]) -> FloatArray:
    """Return a codebook (256,) of version 2; entries that are not there are NaN, so that their use is found."""
    values = np.array(entry["codebook"], np.float32).reshape(-1)[:256]
    if len(values) == 256 and np.isnan(values[0]):
        values[0] = values[1] + (values[1] - values[255]) / 255  # an early writer left null here; viewers mend it so
    return np.pad(values, (0, 256 - len(values)), constant_values=np.nan)
