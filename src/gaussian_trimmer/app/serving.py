"""Starts the app: a viser server that only its own pages, and those who have the token, can talk to."""

from __future__ import annotations

import io
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gaussian_trimmer import sample
from gaussian_trimmer.app.controller import Controller
from gaussian_trimmer.app.guard import guarding, is_loopback
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.errors import InputError

INSTALL = 'pip install "gaussian-trimmer[app]"'
MOST_SHOWN = 400_000
"""Gaussians that are shown at most, unless another number is asked for."""


@dataclass(frozen=True)
class Running:
    """The app while it runs."""

    address: str
    """What to open in a browser, with the token if one is needed."""
    server: Any
    """The viser server."""
    controller: Controller


@contextmanager
def serving(
    scene: Path | None, cameras: Path | None, *, host: str = "127.0.0.1", port: int = 8080, most: int = MOST_SHOWN
) -> Iterator[Running]:
    """Run the app, until the end of the context.

    Args:
        scene: opened at the start; None: the user opens one.
        cameras: the cameras of the scene.
        host: address to listen at. Beyond this machine a token is needed, which the address has.
        port: the first one that is free from this on.
        most: number of Gaussians that are shown at most; larger scenes are thinned for display.

    Raises:
        InputError: viser is not installed or cannot be guarded, or the address is none of this machine's.
    """
    token = "" if is_loopback(host) else secrets.token_urlsafe(24)
    server = _start(host, port, token)
    controller = None
    try:
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
        server.gui.main_panel.dock_right()
        server.scene.world_axes.visible = False
        offered = (str(scene), str(cameras or "")) if scene else (str(sample.SCENE), str(sample.CAMERAS))
        controller = Controller(server, Session(), most, *offered)
        if scene is not None:
            controller.open(*offered)
        shown = f"[{host}]" if ":" in host else host
        address = f"http://{shown}:{server.get_port()}/{f'?token={token}' if token else ''}"
        yield Running(address, server, controller)
    finally:
        if controller is not None:
            controller.stop()
        with redirect_stdout(io.StringIO()):
            server.stop()


def wait(until: Callable[[], bool] = lambda: False) -> None:
    """Wait until a signal comes, or something is so."""
    pause = threading.Event()
    while not until():
        pause.wait(0.5)


def _start(host: str, port: int, token: str) -> Any:
    """A server that listens, guarded.

    Raises:
        InputError: viser is not installed or cannot be guarded, or the address is none of this machine's.
    """
    try:
        import viser
    except ImportError as error:
        raise InputError(f"The app needs viser: {INSTALL}.") from error

    class Server(viser.ViserServer):  # type: ignore[misc, unused-ignore]
        """A server whose pages cannot be published through a stranger's tunnel."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse."""
            return None

    _check_host(host)
    with guarding(token) as started, redirect_stdout(io.StringIO()):  # viser's own greeting says nothing new
        # Without a label, the panel says in its place whether the page is connected.
        server = Server(host=host, port=port, verbose=False)
    if not started:
        server.stop()
        raise InputError(f"This version of viser, {viser.__version__}, cannot be guarded; install another: {INSTALL}.")
    return server


def _check_host(host: str) -> None:
    """Refuse an address at which viser would wait for ever to be able to listen.

    Raises:
        InputError: the address is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0][0]
        socket.create_server((host, 0), family=family).close()
    except (OSError, UnicodeError) as error:
        raise InputError(f"Cannot listen at '{host}': {error}; give an address of this machine to --host.") from error
