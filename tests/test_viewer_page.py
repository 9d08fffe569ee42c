"""Gaussians as one page: what is in it, what is refused, and where the commands write it."""

import base64
import json

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball
from page_reading import Page, check_stands_alone

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.splat import ROW
from gaussian_trimmer.output.html import viewer
from gaussian_trimmer.output.html.viewer import first_angles, first_view, viewer_page, write_viewer
from gaussian_trimmer.trimming.trim import trim

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def parts():
    scene, truth = toy.ball_on_floor()
    return {"object": scene.select(truth), "background": scene.select(~truth)}


def settings_and_rows(page):
    rows = np.frombuffer(base64.b64decode(page.text_of("splats")), ROW)
    return json.loads(page.text_of("settings")), rows


def test_the_page_stands_alone_and_holds_the_gaussians_as_a_splat_file(parts, tmp_path):
    page = Page(viewer_page({"object": parts["object"]}, toy.UP, "ball"))
    check_stands_alone(page)
    settings, rows = settings_and_rows(page)
    formats.write(parts["object"], tmp_path / "a.splat")
    expected = np.frombuffer((tmp_path / "a.splat").read_bytes(), ROW)
    for name in ("scale", "rgba", "rotation"):
        np.testing.assert_array_equal(rows[name], expected[name])
    np.testing.assert_allclose(rows["mean"] + toy.CENTRE, expected["mean"], atol=0.1 * toy.RADIUS)
    assert np.ptp(rows["mean"] - expected["mean"], axis=0).max() < 1e-6, "all are moved alike"
    np.testing.assert_allclose(settings["axes"][2], toy.UP, atol=1e-12)
    assert settings["parts"] == [{"name": "object", "range": [0, len(rows)]}]
    assert not page.all("input", name="part")


def test_of_several_parts_each_can_be_shown_alone(parts):
    page = Page(viewer_page(parts, toy.UP, "both"))
    settings, rows = settings_and_rows(page)
    n = len(parts["object"])
    assert [part["range"] for part in settings["parts"]] == [[0, n], [n, n + len(parts["background"])]]
    assert len(rows) == n + len(parts["background"])
    assert [attributes["value"] for attributes, _ in page.all("input", name="part")] == ["", "object", "background"]


def test_a_scene_far_from_the_origin_keeps_its_details(parts):
    far = parts["object"].replace(means=parts["object"].means + np.float32([4096, -4096, 0]))
    _, rows = settings_and_rows(Page(viewer_page({"object": far}, toy.UP, "far")))
    assert np.abs(rows["mean"]).max() < 2 * toy.RADIUS


def test_too_many_gaussians_are_refused_with_the_limit(parts, tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "MOST_GAUSSIANS", 600)
    with pytest.raises(InputError, match=r"at most 600 Gaussians.* these are 700; show the object alone"):
        write_viewer({"object": parts["object"]}, tmp_path / "a.html", toy.UP)
    assert not list(tmp_path.iterdir())


def test_the_page_opens_on_the_side_that_was_photographed():
    scene, truth = toy.ball_on_floor()
    places = [(np.cos(angle), np.sin(angle), 0.8) for angle in np.radians([170, 190, 210])]
    K = intrinsics(0.8, 64, 64)
    cameras = tuple(Camera(look_at(toy.CENTRE + 6 * np.array(p), toy.CENTRE, toy.UP), K, 64, 64) for p in places)
    result = trim(scene, truth, config=toy.small_config(), cameras=CameraSet(cameras, None, (True,) * 3, False))
    view = first_view(result.bounds, first_angles(result))
    outward = np.cos(view["yaw"]) * result.bounds.axes[0] + np.sin(view["yaw"]) * result.bounds.axes[1]
    assert outward @ np.array([np.cos(np.radians(190)), np.sin(np.radians(190)), 0]) > 0.95


def test_a_result_exports_object_background_or_both(tmp_path):
    scene, truth = toy.ball_on_floor()
    result = trim(scene, toy.dilated(scene, truth), config=toy.small_config())
    counts = {"object": len(result.object), "background": len(result.background)}
    for part, count in {**counts, "both": sum(counts.values())}.items():
        result.export_viewer(tmp_path / f"{part}.html", part)
        _, rows = settings_and_rows(Page((tmp_path / f"{part}.html").read_text(encoding="utf-8")))
        assert len(rows) == count
    with pytest.raises(InputError, match="exists"):
        result.export_viewer(tmp_path / "both.html")
    with pytest.raises(InputError, match="available: object, background, both"):
        result.export_viewer(tmp_path / "c.html", "foreground")
    with pytest.raises(InputError, match=r"ends with \.html"):
        result.export_viewer(tmp_path / "c.ply")


@pytest.fixture
def ball(tmp_path):
    save_ball(tmp_path)
    return tmp_path


def trim_ball(ball, *options):
    command = ["trim", ball / "scene.ply", ball / "rough.npy", "--up", 0, 0, 1, *SMALL, "--output", ball / "out"]
    return run(*command, "--quiet", *options)


def test_the_command_writes_the_page_among_its_results_or_elsewhere(ball):
    assert trim_ball(ball, "--export-viewer", ball / "out" / "ball.html") == 0
    assert trim_ball(ball, "--export-viewer", ball / "ball.html", "--viewer-part", "both", "--overwrite") == 0
    assert (ball / "ball.html").exists()
    assert not (ball / "out" / "ball.html").exists(), "it belonged to the earlier results"


@pytest.mark.parametrize(
    ("name", "reason"),
    [("taken.html", "exists"), ("page.png", "ends with .html"), ("none/page.html", "no folder"),
     ("out/report.html", "--html writes")],
)  # fmt: skip
def test_a_page_that_cannot_be_written_is_refused_before_any_work(ball, name, reason, capsys):
    (ball / "taken.html").write_text("mine")
    assert trim_ball(ball, "--export-viewer", ball / name) == 2
    assert reason in capsys.readouterr().err
    assert not (ball / "out").exists()
    assert (ball / "taken.html").read_text() == "mine"


def test_any_splat_file_can_be_converted_to_a_page(ball, capsys):
    assert run("convert", ball / "scene.ply", ball / "scene.html", "--up", 0, 0, 1) == 0
    assert "scene.html: 1,612 Gaussians" in capsys.readouterr().out.replace("\n", "")
    page = Page((ball / "scene.html").read_text(encoding="utf-8"))
    check_stands_alone(page)
    assert len(settings_and_rows(page)[1]) == 1612
    assert run("convert", ball / "scene.ply", ball / "scene.html") == 2
    assert run("convert", ball / "scene.ply", ball / "a.splat", "--up", 0, 0, 1) == 2
    assert "pages" in capsys.readouterr().err
