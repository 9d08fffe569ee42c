"""The app in a real browser with captures that people made, which are not the project's; skipped where they are not."""

import json

import benchmark_data
import numpy as np
import pytest
from app_tab import Tab, until
from browser import chromium

pytestmark = [pytest.mark.slow, pytest.mark.needs("browser", "viser")]

SHOWN = 40_000
"""Gaussians that are shown: a browser without a GPU takes minutes for pictures of all of them, and so long no click
arrives; clicks, cut-outs and removal take all 1.5 million and a few seconds each."""
SIZE = (1000, 640)
CHAIRS = {"armchair_left": (-1.9, -2.9), "armchair_right": (-1.0, -3.0), "wing_chair": (-0.5, -2.2)}
"""Chairs of the living room, and where one stands to see them, (x, y)."""
EYES, SEATS, FLOOR = 1.3, -0.3, -0.6
"""Heights (z)."""
MADE_UP = -1
"""In place of the row of what was filled in."""


@pytest.fixture
def shown(monkeypatch):
    """What was shown, in order."""
    from gaussian_trimmer.app.scene_view import SceneView

    show, shown = SceneView.show, []
    monkeypatch.setattr(SceneView, "show", lambda view, splats: (shown.append(splats), show(view, splats)))
    return shown


def looked_at(tab, eye, target):
    """Go to a place and look at a point of the scene, as by many keys and drags; return the camera there."""
    client = tab.app.server.get_clients()[tab.client]
    tab.app.controller.jobs.view.look(client, eye, target)
    viewpoint = tab.app.controller.jobs.view.viewpoint
    until(lambda: np.linalg.norm(viewpoint(client).camera.centre - eye) < 0.01, "the view to go there")
    return viewpoint(client).camera


def take(tab, shown, seat, place):
    """Stand before a chair, wait until it is shown in full, click on it, and cut it out, as a new object."""
    session, panels = tab.app.controller.session, tab.app.controller.panels
    camera, means = looked_at(tab, [*place, EYES], seat), session.document.scene.means.astype(np.float64)

    def in_picture(splats):
        return int(camera.contains(camera.project(means[splats.rows[splats.rows >= 0]])[0]).sum())

    until(lambda: in_picture(shown[-1]) > 1.5 * in_picture(shown[0]), "what is near to be shown in full")
    if session.now.object.n_selected:
        tab.press("New object")
        until(lambda: not session.now.object.n_selected, "another object")
    tab.press("Click")
    tab.wait("Click on the object")
    where = tab.place(seat)
    tab.until_said(
        lambda: session.now.object.n_selected or tab.page.mouse.click(*where), "an object that stands on a surface"
    )
    tab.page.keyboard.press("t")
    until(lambda: panels.showing.part == "Object", "the cut-out")
    tab.page.keyboard.press("1")
    until(lambda: panels.showing.part == "Everything", "everything")


def test_a_living_room_is_cleared_of_three_chairs(shown, tmp_path):
    """The capture is shown coarsely first, and refined; each click takes a chair, and only the chairs go."""
    from gaussian_trimmer.app.serving import serving

    apartment = benchmark_data.find("real/apartment")
    things = {thing["name"]: thing for thing in json.loads((apartment / "things.json").read_text("utf-8"))}

    def standing(means, name):
        """Which points stand on the footprint of a thing, (N,)."""
        away = np.abs(means[:, :2] - things[name]["centre"])
        return (away < things[name]["half"]).all(axis=1) & (means[:, 2] > FLOOR) & (means[:, 2] < EYES)

    with chromium() as browser, serving(apartment, None, port=0, most=SHOWN, state=tmp_path) as app:
        session, panels = app.controller.session, app.controller.panels
        tab = Tab(browser, app, *SIZE)
        tab.wait("1,495,636 Gaussians, 40,000 of them shown at once")
        scene = session.document.scene
        for name, place in CHAIRS.items():
            take(tab, shown, np.array([*things[name]["centre"], SEATS]), place)
        tab.page.keyboard.press("3")
        until(lambda: panels.showing.part == "Scene without it", "the scene without them")
        looked_at(tab, [0.5, -2.2, EYES], [-2.0, -3.5, SEATS])
        until(lambda: (shown[-1].rows == MADE_UP).any(), "the floor to go on where they stood")
        until(lambda: not app.controller.jobs.worker.busy, "the program to finish")
        tab.page.screenshot(path=tmp_path / "emptied.png")
        gone = np.any([part.mask for part in session.now.objects], axis=0)
        for name in things:
            share = gone[standing(scene.means, name)].mean()
            assert share > 0.85 if name in CHAIRS else share == 0, name
        assert not np.isin(shown[-1].rows, np.flatnonzero(gone)).any()
        assert tab.errors == []
