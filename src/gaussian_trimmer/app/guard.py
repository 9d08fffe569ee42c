"""Who may talk to the app: a page that it served itself, on this machine, under an address that has its key.

The key is the first part of every path, so the tab keeps it over reloads, and viser's page opens its socket with it.
"""

from __future__ import annotations

import http
import ipaddress
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

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
