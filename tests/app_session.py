"""Marks for the ball of `toy` in a session of the app."""

import toy

from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.selecting.marks import Click, Sphere

BALL = Sphere((0.0, 0.0, 1.0), 1.2)
TOP = Sphere((0.0, 0.0, 2.0), 0.5, effect="remove")
FLOOR = Sphere((0.0, 0.0, 0.0), 0.9)


def click_on_ball(session):
    camera = session.document.cameras.cameras[0]
    x, y = camera.project(toy.CENTRE[None])[0][0].astype(int).tolist()
    return Click(x, y, Viewpoint(camera))
