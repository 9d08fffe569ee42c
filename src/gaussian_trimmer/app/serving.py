"""Starts the app: a server that only pages of its own, on this machine, with the app's key, can talk to.

The key is the first part of every path, so the tab keeps it over reloads. It is kept for the port, so that a tab comes
back to a program that was started again.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import json
import mimetypes
import re
import secrets
import socket
import threading
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

from gaussian_trimmer import sample
from gaussian_trimmer.app.controller import Controller
from gaussian_trimmer.app.jobs import Jobs
from gaussian_trimmer.app.panels import WELCOME
from gaussian_trimmer.app.viewpoints import View
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import private_folder, state_folder, write_private

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp, Receive, Scope, Send
    from starlette.websockets import WebSocket

HOST = "127.0.0.1"
REFUSAL = "Open the address that the program printed, as it stands there, with its key."
PAGE_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers by which a browser runs nothing but the app's own scripts, neither shows the app inside another site's page
nor tells anybody its address."""
MOST_SHOWN = 8_000_000
"""Gaussians that are shown at most, unless another number is asked for."""
NOT_KEPT = "The home cannot be written, so that nothing is kept; set XDG_STATE_HOME to a folder that is writable."
SEVERAL = "All tabs show and change the same scene."
_ASSETS = Path(__file__).parent / "assets"
_KEY_BYTES = 24
_PORTS = 100
_LARGEST_MESSAGE = 1 << 25
_START_SECONDS = 30
_FAREWELL_SECONDS = 0.3
"""Time for the last message to reach the browser."""


def inner_path(path: str, headers: Mapping[str, str], key: str) -> str | None:
    """Return the path of a request after the key; None if the request is to be refused.

    It is refused without the key, from another site's page, and under a name that is not this machine's: somebody else
    has pointed that at it.
    """
    host, origin = headers.get("host", ""), headers.get("origin")
    given, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
    foreign = not _is_loopback(host) or (origin is not None and urlsplit(origin).netloc.lower() != host.lower())
    if foreign or not secrets.compare_digest(given.encode(), key.encode()):
        return None
    return f"/{rest}"


def _is_loopback(host: str) -> bool:
    """Tell whether a Host header names this machine as only itself can."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


class Guard:
    """Lets requests with the key through, pages and sockets, and refuses all others."""

    def __init__(self, app: ASGIApp, key: str) -> None:
        self._app, self._key = app, key

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        from starlette.datastructures import Headers, MutableHeaders
        from starlette.responses import PlainTextResponse, Response

        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        path = inner_path(scope["path"], Headers(scope=scope), self._key)
        nonce = re.fullmatch(r"/proof/([0-9a-f]{32})", scope["path"])
        if nonce and scope["type"] == "http" and inner_path(f"/{self._key}/", Headers(scope=scope), self._key):
            return await Response(self._proof(nonce[1]), headers=PAGE_HEADERS)(scope, receive, send)
        if path is None:
            if scope["type"] == "websocket":
                return await send({"type": "websocket.close", "code": 1008})
            return await PlainTextResponse(f"{REFUSAL}\n", 403, PAGE_HEADERS)(scope, receive, send)

        async def send_with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(PAGE_HEADERS)
            await send(message)

        return await self._app({**scope, "path": path, "raw_path": path.encode()}, receive, send_with_headers)

    def _proof(self, nonce: str) -> bytes:
        """Return what only who has the key can say of a tab's nonce: the tab sends the key to nobody else."""
        return hmac.digest(self._key.encode(), nonce.encode(), "sha256")


class Connection:
    """A tab, as long as its socket is open."""

    def __init__(self, offers: dict[str, tuple[str, bytes]]) -> None:
        """Send files by way of `offers`, which is from their addresses to names and contents."""
        self.view: View | None = None
        self._offers, self._loop = offers, asyncio.get_running_loop()
        self._waiting = asyncio.Queue[dict[str, Any] | bytes | None]()

    def send(self, message: dict[str, Any] | bytes | None) -> None:
        """Tell the tab something, or that this was all; any thread may."""
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._waiting.put_nowait, message)

    def send_file(self, name: str, data: bytes) -> None:
        """Have the tab download a file, which it can do once."""
        token = secrets.token_urlsafe(_KEY_BYTES)
        self._offers[token] = name, data
        self.send({"download": f"file/{token}", "name": name})

    async def write(self, wire: WebSocket) -> None:
        """Write to the socket what there is to tell, in order."""
        with suppress(Exception):  # the tab is gone
            while (message := await self._waiting.get()) is not None:
                await (wire.send_bytes(message) if isinstance(message, bytes) else wire.send_text(json.dumps(message)))


def make_app(controller: Controller, state: Path, key: str) -> Starlette:
    """Return what answers requests, for a controller whose files are kept in a folder."""
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.responses import Response as Answer
    from starlette.responses import StreamingResponse
    from starlette.routing import Route, WebSocketRoute

    jobs, offers = controller.jobs, dict[str, tuple[str, bytes]]()

    def bytes_or_nothing(data: bytes | None, kind: str = "application/octet-stream", **headers: str) -> Response:
        return Answer(data or b"", 404 if data is None else 200, headers, kind)

    async def page(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        path = _ASSETS / name
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        return bytes_or_nothing(path.read_bytes() if re.fullmatch(r"\w+\.\w+", name) and path.is_file() else None, kind)

    def splats(request: Request) -> Response:
        return StreamingResponse(jobs.view.portions(request.path_params["number"]))

    def layer(request: Request) -> Response:
        return bytes_or_nothing(jobs.view.layer(request.path_params["number"]))

    def picture(request: Request) -> Response:
        return bytes_or_nothing(jobs.view.picture(request.path_params["number"]), "image/jpeg")

    async def download(request: Request) -> Response:
        name, data = offers.pop(request.path_params["token"], ("", None))
        return bytes_or_nothing(data, **{"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"})

    async def upload(request: Request) -> Response:
        name, digest = request.path_params["name"], hashlib.sha256()
        try:
            with TemporaryDirectory(dir=private_folder(state)) as folder:
                with Path(folder, "part").open("wb") as part:
                    async for chunk in request.stream():
                        digest.update(chunk)
                        part.write(chunk)
                path = jobs.files.store(name, Path(part.name), digest.hexdigest())
        except OSError as error:
            jobs.panels.say(f"'{name}' could not be taken: {error.strerror}.", wrong=True)
            return Answer(status_code=507)
        asker = next((tab for tab in jobs.page.tabs if str(id(tab)) == request.query_params.get("tab")), None)
        await asyncio.to_thread(controller.receive, path, asker, beside="beside" in request.query_params)
        return Answer(status_code=204)

    async def talk(wire: WebSocket) -> None:
        await wire.accept()
        tab = Connection(offers)
        writing = asyncio.create_task(tab.write(wire))
        tab.send({"tab": str(id(tab))})
        jobs.page.welcome(tab)
        if len(jobs.page.tabs) > 1:
            tab.send({"state": {"said": SEVERAL}})
        try:
            while (said := await wire.receive())["type"] == "websocket.receive":
                jobs.page.hear(said.get("text") or said.get("bytes") or b"", tab)
        finally:
            jobs.page.forget(tab)
            tab.send(None)
            await writing

    routes = [
        Route("/", page),
        Route("/assets/{name}", page),
        Route("/splats/{number:int}", splats),
        Route("/layer/{number:int}", layer),
        Route("/view/{number:int}", picture),
        Route("/file/{token}", download),
        Route("/upload/{name}", upload, methods=["POST"]),
        WebSocketRoute("/socket", talk),
    ]
    return Starlette(routes=routes, middleware=[Middleware(Guard, key=key)])


@dataclass(frozen=True)
class Running:
    """The app while it runs."""

    address: str
    """What to open in a browser; whoever has it can do what the app's user can."""
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
        state: folder of what the app keeps; the user's own one if it is not given, and one that is gone at the end if
            that cannot be written.

    Raises:
        InputError: what the app needs is not installed, or no port is free.
    """
    try:
        for name in ("starlette", "uvicorn", "websockets"):
            import_module(name)
    except ImportError as error:
        needs = (
            f"The app needs Starlette, uvicorn and websockets ({error}); in the program's clone: pip install '.[app]'."
        )
        raise InputError(needs) from error
    with ExitStack() as stack:
        wire = stack.enter_context(_listening(port))
        kept = True
        try:
            state = private_folder(state or state_folder())
        except InputError:
            state, kept = Path(stack.enter_context(TemporaryDirectory())), False
        number = wire.getsockname()[1]
        key = _key(state, number) if port else secrets.token_urlsafe(_KEY_BYTES)
        page = state / f"open-{number}.html"
        stack.callback(page.unlink, missing_ok=True)
        offered = (str(scene), str(cameras or "")) if scene else (str(sample.SCENE), str(sample.CAMERAS))
        jobs = Jobs(most, state, offered)
        controller = Controller(jobs)
        if not kept:
            jobs.panels.say(f"{WELCOME} {NOT_KEPT}")
        stop = _run(make_app(controller, state, key), wire)
        try:
            if scene is not None:
                controller.open()
            yield Running(f"http://{HOST}:{number}/{key}/", controller, page)
        finally:
            jobs.stop()
            threading.Event().wait(_FAREWELL_SECONDS)
            stop()


def wait() -> None:
    """Wait until a signal comes."""
    while True:
        threading.Event().wait(0.5)


def _key(state: Path, port: int) -> str:
    """Return the key that is kept for a port; it is drawn if there is none."""
    path = state / f"key-{port}"
    with suppress(OSError, UnicodeDecodeError):
        if re.fullmatch(r"[\w-]{32}", key := path.read_text()):
            return key
    key = secrets.token_urlsafe(_KEY_BYTES)
    write_private(path, key)
    return key


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    """Listen at the first port that is free from one on."""
    with socket.socket() as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for number in range(port, min(port + _PORTS, 1 << 16)):
            with suppress(OSError):
                wire.bind((HOST, number))
                wire.listen()
                break
        else:
            raise InputError(f"No port is free from {port} on; give another one by --port.")
        yield wire


def _run(app: Any, wire: socket.socket) -> Any:
    """Run a server in a thread of its own; return what stops it."""
    import uvicorn

    options: dict[str, Any] = {"ws": "websockets-sansio", "ws_max_size": _LARGEST_MESSAGE, "log_level": "error"}
    server = uvicorn.Server(uvicorn.Config(app, lifespan="off", timeout_graceful_shutdown=1, **options))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [wire]}, daemon=True)
    thread.start()
    for _ in range(100 * _START_SECONDS):
        if server.started or not thread.is_alive():
            break
        threading.Event().wait(0.01)

    def stop() -> None:
        server.should_exit = True
        thread.join(_START_SECONDS)

    return stop
