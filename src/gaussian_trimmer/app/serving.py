"""Starts the app: a viser server that only pages of its own, on this machine, with the app's key, can talk to.

The key is the first part of every path, so the tab keeps it over reloads, and viser's page opens its socket with it.
"""

from __future__ import annotations

import http
import io
import ipaddress
import secrets
import threading
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from gaussian_trimmer import sample
from gaussian_trimmer.app.controller import Controller
from gaussian_trimmer.app.jobs import Jobs
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import private_folder, state_folder, write_private

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    Answer = Callable[[ServerConnection, Request], Response | None]

REFUSAL = "Open the address that the program printed, as it stands there, with its key."
PAGE_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers by which a browser neither shows the app inside another site's page nor tells anybody its address."""


def inner_path(path: str, headers: Mapping[str, str], key: str) -> str | None:
    """Return the path of a request after the key; None if the request is to be refused.

    It is refused without the key, from another site's page, and under a name that is not this machine's: somebody else
    has pointed that at it.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    given, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
    foreign = not _is_loopback(host) or (origin is not None and urlsplit(origin).netloc.lower() != host.lower())
    if foreign or not secrets.compare_digest(given.encode(), key.encode()):
        return None
    return f"/{rest}"


def guarded(answer: Answer, key: str) -> Answer:
    """Return a function that answers requests with the key, pages and sockets, and refuses all others."""

    def check(connection: ServerConnection, request: Request) -> Response | None:
        path = inner_path(request.path, request.headers, key)
        if path is None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{REFUSAL}\n")
        request.path = path
        response = answer(connection, request)
        if response is not None:
            response.headers.update(PAGE_HEADERS)
        return response

    return check


@contextmanager
def guarding_viser(key: str) -> Iterator[list[Answer]]:
    """Guard the server that viser starts meanwhile; yield the list of functions that were guarded.

    viser takes neither a `process_request` nor origins for its server, so the function of websockets with which it
    starts one is wrapped for as long as the start takes.
    """
    import websockets.asyncio.server as servers

    original, guards = servers.serve, list["Answer"]()

    def serve(*arguments: Any, process_request: Answer, **options: Any) -> Any:
        guards.append(guarded(process_request, key))
        return original(*arguments, process_request=guards[-1], **options)

    servers.serve = serve  # type: ignore[assignment, misc, unused-ignore]
    try:
        yield guards
    finally:
        servers.serve = original  # type: ignore[misc, unused-ignore]


def _is_loopback(host: str) -> bool:
    """Tell whether a Host header names this machine as only itself can."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


HOST = "127.0.0.1"
INSTALL = 'pip install "gaussian-trimmer[app]"'
MOST_SHOWN = 400_000
"""Gaussians that are shown at most, unless another number is asked for."""
_KEY_BYTES = 24
_FAREWELL_SECONDS = 0.3
"""Time for the last message to reach the browser."""


@dataclass(frozen=True)
class Running:
    """The app while it runs."""

    address: str
    """What to open in a browser; whoever has it can do what the app's user can."""
    server: Any
    """The viser server."""
    controller: Controller
    page: Path
    """A file of the user's own that leads to the address."""

    def open_browser(self) -> None:
        """Open the address by way of a file, since every user of a machine can read what programs were started with."""
        write_private(self.page, f'<meta http-equiv="refresh" content="0;url={self.address}">')
        webbrowser.open(self.page.as_uri())


@contextmanager
def serving(
    scene: Path | None, cameras: Path | None, *, port: int = 8080, most: int = MOST_SHOWN, state: Path | None = None
) -> Iterator[Running]:
    """Run the app, until the end of the context. Only this machine can reach it, and only with the key.

    Args:
        scene: opened at the start; None: the user opens one.
        cameras: the cameras of the scene.
        port: the first one that is free from this on.
        most: number of Gaussians that are shown at most; larger scenes are thinned for display.
        state: folder of what the app keeps; the user's own one if it is not given.

    Raises:
        InputError: viser is not installed or cannot be guarded, or the folder cannot be made.
    """
    key = secrets.token_urlsafe(_KEY_BYTES)
    try:
        state = private_folder(state or state_folder())
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}; set XDG_STATE_HOME to a folder that is writable.") from error
    server = _start(port, key)
    page = state / f"open-{server.get_port()}.html"
    jobs = None
    try:
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="medium")
        server.gui.main_panel.dock_right()
        server.scene.world_axes.visible = False
        offered = (str(scene), str(cameras or "")) if scene else (str(sample.SCENE), str(sample.CAMERAS))
        jobs = Jobs(server, most, state, offered)
        controller = Controller(jobs)
        if scene is not None:
            controller.open()
        yield Running(f"http://{HOST}:{server.get_port()}/{key}/", server, controller, page)
    finally:
        with suppress(OSError):
            page.unlink()
        if jobs is not None:
            jobs.stop()
            threading.Event().wait(_FAREWELL_SECONDS)
        with redirect_stdout(io.StringIO()):
            server.stop()


def wait() -> None:
    """Wait until a signal comes."""
    while True:
        threading.Event().wait(0.5)


def _start(port: int, key: str) -> Any:
    """Start a guarded server that listens; viser has to be there."""
    try:
        import viser
    except ImportError as error:
        raise InputError(f"The app needs viser: {INSTALL}.") from error

    with guarding_viser(key) as guards, redirect_stdout(io.StringIO()):  # viser's own greeting says nothing new
        server: Any = viser.ViserServer(host=HOST, port=port, verbose=False)
    server.request_share_url = lambda *_, **__: None  # clients can ask for a public tunnel, also without its button
    if not guards:
        server.stop()
        raise InputError(f"This version of viser, {viser.__version__}, cannot be guarded; install another: {INSTALL}.")
    return server
