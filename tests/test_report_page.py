"""`report.html`: all that a trim has to show, on one page, whatever strangers call their files."""

import json
from dataclasses import replace

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball
from page_reading import Page, check_stands_alone

from gaussian_trimmer.output.pages import DISCARDED, FITTED, coloured_changes, legend_of, report_page
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import LABEL_NAMES
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim

pytestmark = pytest.mark.usefixtures("one_thread")
HOSTILE = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>.ply"


def page_of(result, **inputs):
    return Page(report_page(result, describe(result, inputs, {"read": 0.25})))


def trimmed(**stages):
    scene, truth = toy.ball_on_floor()
    return trim(scene, toy.dilated(scene, truth), config=toy.small_config(**stages))


@pytest.fixture(scope="module")
def result():
    return trimmed()


@pytest.fixture(scope="module")
def page(result):
    return page_of(result, scene="ball.ply", selection="rough.npy")


def test_the_page_stands_alone(page):
    check_stands_alone(page)
    assert page.all("title")[0][1] == 'ball.ply, trimmed from "rough.npy"'


def test_every_view_can_be_compared_and_has_its_pictures(page, result):
    alternatives = [attributes["alt"] for attributes, _ in page.all("img")]
    layers = ("selection", "trimmed object", "outlines", "what was done", "scene", "scene without the object")
    views = result.objects[0].views
    assert sorted(alternatives) == sorted(f"view {i}: {layer}" for i in range(len(views)) for layer in layers)
    sliders = [attributes for attributes, _ in page.all("input", type="range") if "id" not in attributes]
    assert len(sliders) == len(views)
    assert all(attributes["aria-label"] for attributes in sliders)


def test_counts_times_settings_and_doubts_are_told(result):
    doubtful = toy.with_object(result, warnings=("Something may be wrong.",))
    page = page_of(doubtful)
    report = describe(doubtful)
    numbers = page.text_of("numbers")
    for name, count in report["counts"].items():
        assert f"{name.replace('_', ' ')}{count:,}" in numbers
    for name in ("plan.size160", "read0.25 s"):
        assert name in numbers
    for name, said in zip(("object-1", "scene"), sentences(report), strict=True):
        assert said in page.text_of(name)
    assert [text for attributes, text in page.all("ul", role="alert")] == ["Something may be wrong."]


def test_the_legend_has_every_label_with_its_count_and_a_colour_of_its_own(page, result):
    legend = legend_of(result, describe(result))
    assert [name for name, *_ in legend] == [*LABEL_NAMES, DISCARDED, FITTED]
    assert len({colour for _, colour, *_ in legend}) == len(legend)
    counts = {name: count for name, _, _, count in legend}
    assert counts["removed"] == describe(result)["objects"][0]["counts"]["removed"] > 0
    assert (counts[DISCARDED], counts[FITTED]) == (len(result.discarded), len(result.objects[0].fitted))
    for name, count in counts.items():
        assert f"{name.replace('_', ' ')}{count:,}" in page.text_of("changes")


def test_fitted_gaussians_have_a_colour_and_a_line_in_the_legend():
    result = trimmed(refine="fit")
    assert len(result.objects[0].fitted)
    colours = {name: colour for name, colour, *_ in legend_of(result, describe(result))}
    kept = np.flatnonzero(result.objects[0].label == RowLabel.KEPT)
    is_coloured = np.ptp(coloured_changes(result, result.objects[0]).sh_dc[kept], axis=1) > 0.5
    assert colours[FITTED] == "#e69f00"
    assert np.array_equal(is_coloured, np.isin(kept, result.objects[0].fitted)) and is_coloured.any()


def test_names_of_strangers_are_shown_as_text(result):
    views = tuple(
        replace(view, rejected=HOSTILE, view=replace(view.view, camera=replace(view.view.camera, name=HOSTILE)))
        for view in result.objects[0].views
    )
    hostile = toy.with_object(result, views=views, warnings=(HOSTILE,), refused=HOSTILE)
    page = page_of(hostile, scene=HOSTILE, selection=f"</title>{HOSTILE}", selection_options={HOSTILE: HOSTILE})
    name = HOSTILE.split("/")[-1]
    check_stands_alone(page)
    assert len(page.all("script")) == 1
    assert page.all("h1")[0][1] == page.all("title")[0][1] == f'{name}, trimmed from "{name}"'
    assert HOSTILE in page.text_of("numbers")


def test_refused_trims_and_views_are_shown_as_such():
    scene, truth = toy.ball_on_floor()
    refused = toy.trim_by(toy.empty, scene, toy.dilated(scene, truth), config=toy.small_config())
    page = page_of(refused)
    (_, verdict), *_ = page.all("p", role="alert")
    assert verdict.startswith("Not trimmed: only 0 of 5 views were accepted")
    assert len([a for a, _ in page.all("figure") if a["class"] == "doubtful"]) == 5
    assert page.text_of("object-1").count("rejected: ") == 5


def test_what_there_is_nothing_of_is_said(result):
    wrong = toy.with_object(result, views=(), refused="The rows are in another order.")
    page = page_of(wrong)
    assert "No views: the inputs were found wrong" in page.text_of("object-1")
    assert "Not trimmed: The rows are in another order." in page.all("p", role="alert")[0][1]
    scene, truth = toy.ball_on_floor()
    ball = scene.select(truth)
    alone = toy.trim_by(toy.empty, ball, np.ones(len(ball), np.bool_), config=toy.small_config())
    assert "Nothing is left" in page_of(alone).text_of("scene")


def test_the_whole_scene_is_shown_from_training_cameras(result):
    cameras = tuple(replace(view.view.camera, name=f"IMG_{i}.JPG") for i, view in enumerate(result.objects[0].views))
    page = page_of(replace(result, cameras=cameras))
    names = [attributes["alt"] for attributes, _ in page.all("img") if "the whole scene" in attributes["alt"]]
    assert names[0] == "the whole scene from IMG_0.JPG: scene"
    assert len(names) == 4


def test_many_views_are_thinned_but_those_that_were_rejected_stay(result):
    views = [replace(result.objects[0].views[i % 5], rejected="because" if i in (7, 30) else "") for i in range(40)]
    page = page_of(toy.with_object(result, views=tuple(views)))
    shown = {a["alt"].split(":")[0] for a, _ in page.all("img") if a["alt"].startswith("view ")}
    assert len(shown) == 12
    assert {"view 7", "view 30"} <= shown
    assert "28 of 40 views are not shown." in page.text_of("object-1")


def test_several_objects_have_a_section_each_and_a_later_run_without_the_page_removes_it(tmp_path, capsys):
    ball = tmp_path
    save_ball(ball)
    scene, truth = toy.ball_on_floor()
    floor = ~truth & (np.abs(scene.means[:, 0] - 2) < 0.6) & (np.abs(scene.means[:, 1] - 2) < 0.6)
    np.save(ball / "labels.npy", np.where(toy.dilated(scene, truth), 1, np.where(floor, 2, 0)))
    command = ["trim", ball / "scene.ply", "--labels", ball / "labels.npy", "--up", 0, 0, 1, *SMALL]
    assert run(*command, "--output", ball / "out", "--html") == 0
    assert "report.html" in capsys.readouterr().out
    page = Page((ball / "out" / "report.html").read_text(encoding="utf-8"))
    check_stands_alone(page)
    report = json.loads((ball / "out" / "report.json").read_text())
    assert page.all("h1")[0][1] == "scene.ply: 2 objects, trimmed"
    for entry in report["objects"]:
        section = page.text_of(f"object-{entry['id']}")
        assert (f"Not trimmed: {entry['refused']}" if entry["refused"] else f"{entry['gaussians']:,}") in section
        counts = entry["counts"]
        fates = ("kept", "cut", "removed", "discarded", "went_to_other_objects")
        assert counts["selected"] == sum(counts[fate] for fate in fates)
        assert entry["file"] == f"object_{entry['id']}.ply" and (ball / "out" / entry["file"]).is_file()
    for layer in ("selection", "trimmed object", "scene", "scene without the object"):
        assert len(page.all("img", alt=f"view 0: {layer}")) == 2
    assert run(*command, "--output", ball / "out", "--overwrite", "--quiet") == 0
    assert not (ball / "out" / "report.html").exists()
