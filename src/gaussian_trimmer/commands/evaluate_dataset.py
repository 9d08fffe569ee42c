"""`gaussian-trimmer evaluate nvos` and the other data sets: methods before and after trimming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, print_run
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.dataset_tables import table_beside_published, table_of_looks, table_of_tasks
from gaussian_trimmer.evaluation.dataset_tasks import chosen_tasks, trials_of
from gaussian_trimmer.evaluation.layouts import LAYOUTS
from gaussian_trimmer.evaluation.predictions import PredictionPatterns, find_predictions
from gaussian_trimmer.evaluation.protocols import OWN, Protocol, protocol_of
from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.rendered_masks import score_rendered
from gaussian_trimmer.evaluation.runs import Run, Variant, measure
from gaussian_trimmer.evaluation.scoring import RULES, Judge
from gaussian_trimmer.evaluation.statistics import table_of_statistics
from gaussian_trimmer.evaluation.task_ids import ids_of_tasks
from gaussian_trimmer.masks import DEFAULT_SEGMENTER, SEGMENTERS, options_of, segmenter_with
from gaussian_trimmer.options import Names, Positional, arg
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings, to_plain
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.trim_options import SegmenterOptions, preset_values


@dataclass(frozen=True)
class _EvaluateDataset:
    layout: ClassVar[str]
    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder of the data set."""
    predictions: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")] = ()
    """Output folders of segmentation methods, one or several; a method is called like its folder."""
    masks_only: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")] = ()
    """Folders of masks that methods rendered themselves: these are scored as they are, and nothing is trimmed."""
    protocol: str = OWN
    """Rules of the comparison: this program's, or those of a published code, which docs/evaluation.md lists. Published
    figures stand beside those of the same protocol alone."""
    tasks: tuple[str, ...] = ()
    """Only these tasks."""
    patterns: Annotated[PredictionPatterns, arg(name="")] = field(default_factory=PredictionPatterns)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of the trimmer's settings: those of this program, or those of the GaussianTrimmer paper."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """How the object is found in the views."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    segmenter_options: Annotated[Any, arg(name="")] = field(default_factory=SegmenterOptions)
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    quiet: bool = False
    """Print nothing but errors."""

    @classmethod
    def presets(cls, given: Mapping[Names, Any]) -> dict[Names, Any]:
        """Return the values that a preset has for fields; options given beside it come on top."""
        return preset_values(given)

    def run(self) -> None:
        """Trim every prediction, measure before and after, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used; everything is looked for before the first trim.
        """
        check_settings(self.config)
        check_settings(self.segmenter_options)
        check_settings(self.selection_options, "selection")
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        layout, protocol = LAYOUTS[self.layout], protocol_of(self.layout, self.protocol)
        if self.protocol != OWN and self.rules.threshold not in (RuleOptions.threshold, protocol.threshold):
            raise InputError(f"The protocol '{self.protocol}' has the threshold {protocol.threshold:g}; leave it out.")
        judge = self.rules.judge()
        judge = judge if self.protocol == OWN else replace(judge, threshold=protocol.threshold)
        methods = self._runs(judge, protocol)
        views = self.config.plan.views
        trimmed = f"trimmed with the preset '{self.preset}', {views} views, {self.segmenter}"
        rules = [judge.describe()] if self.protocol == OWN else [protocol.describe(), judge.tools()]
        notes = [*rules, *([trimmed] if self.predictions else [])]
        notes += [f"masks that methods rendered: white > {protocol.masks_above:g}"] if self.masks_only else []
        notes += [made_by()]
        tables = {f"{self.layout}-{name}": table_of_tasks(layout, name, runs, notes) for name, runs in methods.items()}
        tables[self.layout] = table_beside_published(layout, methods, notes, protocol)
        metrics = [name + RULES[rule] for rule in protocol.rules for name in ("iou", layout.second)]
        title = f"{layout.title}: how sure the means are"
        tables[f"{self.layout}-statistics"] = table_of_statistics(title, methods, metrics, notes, layout.mean_over)
        if self.rules.clip:
            tables[f"{self.layout}-clip"] = table_of_looks(layout, methods, notes)
        return Findings(tables, [run for runs in methods.values() for run in runs], self._settings())

    def _settings(self) -> dict[str, Any]:
        """Everything that the figures depend on."""
        used = options_of(self.segmenter, self.segmenter_options)
        chosen = {"protocol": self.protocol, "preset": self.preset, "segmenter": self.segmenter}
        return {
            **chosen, "segmenter_options": to_plain(used) if used else {},
            "config": to_plain(self.config), "rules": to_plain(self.rules),
            "selection_options": to_plain(self.selection_options),
        }  # fmt: skip

    def _runs(self, judge: Judge, protocol: Protocol) -> dict[str, list[Run]]:
        """The runs of every method."""
        tasks = chosen_tasks(LAYOUTS[self.layout], self.root, self.tasks)
        names = method_names([*self.masks_only, *self.predictions])
        found = [find_predictions(tasks, folder, self.patterns, self.root) for folder in self.predictions]
        file = self.patterns.ids
        ids = [ids_of_tasks(file, tasks, predictions) if file else {} for predictions in found]
        variant: dict[str, Variant] = {
            self.preset: Variant(self.config, segmenter_with(self.segmenter, self.segmenter_options))
        }
        # Lines on the progress belong to no CSV or JSON.
        progress = open_console(quiet=self.quiet or self.tables.for_programs)
        methods = {
            name: score_rendered(folder, [protocol.counted(task) for task in tasks], name, judge, protocol)
            for name, folder in zip(names, self.masks_only, strict=False)
        }
        for name, predictions, own_ids in zip(names[len(methods) :], found, ids, strict=True):
            methods[name] = []
            for trial in trials_of(tasks, predictions, name, self.selection_options, protocol, own_ids):
                (run,) = measure(trial, variant, judge, fidelity=False)
                methods[name].append(run)
                print_run(run, progress)
        return methods


@dataclass(frozen=True)
class Nvos(_EvaluateDataset):
    """Measure methods on NVOS before and after trimming, beside the published figures.

    ROOT holds masks/<task>/<target>_mask.png. In a method's folder each task has its files in <task>/ or <scene>/:
    scene.ply or point_cloud/iteration_*/point_cloud.ply, a selection or object file, and cameras; or name the files
    with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "nvos"


@dataclass(frozen=True)
class LerfMask(_EvaluateDataset):
    """Measure methods on LERF-Mask before and after trimming.

    ROOT holds <scene>/test_mask/<view>/<words>.png with <scene>/images and <scene>/images_train. In a method's folder
    each object has its files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "lerf-mask"


@dataclass(frozen=True)
class SpinNerf(_EvaluateDataset):
    """Measure methods on SPIn-NeRF's masks before and after trimming, beside the published figures.

    ROOT holds <scene>/<picture>.png or <scene>/masks/<picture>.png. In a method's folder each scene has its files in
    <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "spin-nerf"


@dataclass(frozen=True)
class LerfOvs(_EvaluateDataset):
    """Measure methods on LERF-OVS before and after trimming.

    ROOT holds label/<scene>/<picture>.json with polygons, and <scene>/images. In a method's folder each object has its
    files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "lerf-ovs"


@dataclass(frozen=True)
class Ovs3d(_EvaluateDataset):
    """Measure methods on 3D-OVS before and after trimming.

    ROOT holds <scene>/segmentations/<view>/<words>.png and <scene>/images. In a method's folder each object has its
    files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "3d-ovs"


def method_names(folders: Sequence[Path]) -> list[str]:
    """The names of methods: those of their folders.

    Raises:
        InputError: no folder is given, or two have the same name.
    """
    names = [folder.resolve().name for folder in folders]
    if not names or len(set(names)) < len(names):
        raise InputError(
            "Give folders with different names after --predictions or --masks-only; given: "
            f"{', '.join(names) or 'none'}."
        )
    return names
