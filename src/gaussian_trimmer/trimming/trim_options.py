"""The options of a trim: what the command line and the rows of a batch's manifest may say beside naming files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.masks import (
    DEFAULT_SEGMENTER,
    PAPER_SEGMENTER,
    SEGMENTERS,
    Segmenter,
    all_options,
    field_name,
    options_kind,
    options_of,
    paper_options,
    segmenter_with,
)
from gaussian_trimmer.options import Names, arg
from gaussian_trimmer.settings import from_plain, hints_of
from gaussian_trimmer.trimming.config import PlanConfig, TrimConfig, paper_config

SegmenterOptions = all_options()


@dataclass(frozen=True, kw_only=True)
class TrimOptions:
    """How an object is trimmed."""

    trust_paths: bool = False
    """Open pictures that a transforms.json names outside its folder, if it does not say their size."""
    level: Annotated[int | None, arg(metavar="N", default="the finest that memory allows")] = None
    """Level of detail of a streamed SOG (lod-meta.json); 0 is the finest."""
    format: Annotated[str | None, arg(metavar="ENDING", default="that of the scene")] = None
    """Format of object and background: ply, compressed.ply, splat, spz, sog or glb."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of all settings: this program's, or those of the GaussianTrimmer paper."""
    config_file: Annotated[Path | None, arg(metavar="FILE", name="config")] = None
    """Trim as an earlier run did: with the settings in its report.json or settings.json, to which options given beside
    it are added. 'trim' also takes scene, selection and cameras from there."""
    views: Annotated[int | None, arg(metavar="INT")] = None
    """Number of virtual views. Short for --plan.views."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """How the object is found in the views."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    segmenter_options: Annotated[Any, arg(name="")] = field(default_factory=SegmenterOptions)

    @classmethod
    def presets(cls, given: Mapping[Names, Any]) -> dict[Names, Any]:
        """Return the values that a file of settings or a preset has for fields; options beside it come on top."""
        path = given.get(("config_file",))
        if path is None:
            return preset_values(given)
        if ("preset",) in given:
            raise InputError("--config has the value of every setting, so that --preset changes none; leave one out.")
        return settings_in(path)

    def settings(self) -> TrimConfig:
        """Return the settings of all stages."""
        if self.views is None:
            return self.config
        return replace(self.config, plan=replace(self.config.plan, views=self.views))

    def used_options(self) -> Any:
        """Return the options of the segmenter that is used, or None if it has none."""
        return options_of(self.segmenter, self.segmenter_options)

    def make_segmenter(self) -> Segmenter:
        """Return the segmenter with its options."""
        return segmenter_with(self.segmenter, self.segmenter_options)

    def promptable_model(self) -> Any:
        """Return the segmenter if it also draws masks for clicks and boxes; None for others."""
        return self.make_segmenter() if self.segmenter == "sam" else None


def preset_values(given: Mapping[Names, Any]) -> dict[Names, Any]:
    """Return the paper's `config`, `segmenter` and `segmenter_options` if the option `preset` asks for them."""
    if given.get(("preset",)) != "paper":
        return {}
    options = paper_options(SegmenterOptions())
    return {("config",): paper_config(), ("segmenter",): PAPER_SEGMENTER, ("segmenter_options",): options}


def settings_in(path: Path) -> dict[Names, Any]:
    """Return the fields of `TrimOptions` that a report, or the settings of an evaluation, has values for.

    Raises:
        InputError: the file cannot be read, holds no settings, or has one that is not possible.
    """
    data = read_json(path)
    config = data.get("configuration", data.get("config")) if isinstance(data, dict) else None
    if not isinstance(config, dict):
        raise InputError(f"'{path}' holds no settings; give the report.json of a trim, or a settings.json.")
    where, inputs = f"'{path}': ", data.get("inputs", data)
    found: dict[Names, Any] = {("config",): from_plain(config, TrimConfig, f"{where}configuration")}
    segmenter = inputs.get("segmenter", data.get("segmenter"))
    if segmenter in SEGMENTERS:
        found["segmenter",] = segmenter
    for name in ("level", "trust_paths", "format", "preset"):
        if inputs.get(name) is not None:
            found[name,] = from_plain(inputs[name], hints_of(TrimOptions)[name], f"{where}{name}")
    kind = options_kind(str(found.get(("segmenter",), DEFAULT_SEGMENTER)))
    if kind is not None and inputs.get("segmenter_options"):
        own = from_plain(inputs["segmenter_options"], kind, f"{where}segmenter_options")
        found["segmenter_options", field_name(segmenter)] = own
    return found


def views_of_masks(segmenter: Segmenter, cameras: CameraSet | None, config: TrimConfig) -> list[Camera] | None:
    """Return the cameras of the masks that a segmenter has; None if it segments any view.

    Raises:
        InputError: the settings ask for a number of virtual views, which would not be used.
    """
    if not hasattr(segmenter, "own_cameras"):
        return None
    views: list[Camera] = segmenter.own_cameras(cameras)
    if config.plan.views != PlanConfig().views:
        raise InputError(
            f"The segmenter '{segmenter.name}' looks from the cameras of its {len(views)} masks, so "
            f"{config.plan.views} virtual views cannot be had; leave --views and --plan.views out, or remove masks "
            "from their folder."
        )
    return views
