"""`--config FILE`: what an earlier run read, and how it trimmed, from the report that it wrote."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.options import Names
from gaussian_trimmer.output.engines import PlacingOptions
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import from_plain

# Entry of a report's inputs -> names of the fields of `Trim`, and the type.
_FIELDS: dict[str, tuple[Names, Any]] = {
    "scene": (("inputs", "scene"), Path),
    "cameras": (("inputs", "cameras"), Path | None),
    "selection": (("selection",), Path | None),
    "selection_options": (("selection_options",), SelectionOptions),
    "labels": (("labels",), Path | None),
    "objects": (("objects",), tuple[int, ...]),
    "exclude": (("exclude",), tuple[Path, ...]),
    "photos": (("results", "photos"), Path | None),
    "placing": (("results", "placing"), PlacingOptions),
    "write_background": (("results", "write_background"), bool),
}
_WHAT_TO_SELECT = ("selection", "selection_options", "labels", "objects")


def inputs_of_report(path: Path, given: Mapping[Names, Any]) -> dict[Names, Any]:
    """Return the inputs of the run that wrote a report, by the fields of `Trim`; none if the file is no report.

    A selection, or labels, that are given take the place of all that said what to select.

    Raises:
        InputError: the file cannot be read, or an input is not possible.
    """
    report = read_json(path)
    inputs = report.get("inputs") if isinstance(report, dict) else None
    if not isinstance(inputs, dict):
        return {}
    if inputs.get("marks") is not None:  # they lie beside the report
        inputs = inputs | {"selection": str(path.parent / str(inputs["marks"])), "selection_options": {}}
    if ("selection",) in given or ("labels",) in given:
        inputs = {name: value for name, value in inputs.items() if name not in _WHAT_TO_SELECT}
    found = {
        names: from_plain(inputs[name], kind, f"'{path}': inputs.{name}")
        for name, (names, kind) in _FIELDS.items()
        if inputs.get(name) is not None
    }
    if ("inputs", "scene") not in found.keys() | given.keys():
        raise InputError(f"'{path}' does not name the scene that was trimmed; give it: trim SCENE --config {path}.")
    return found
