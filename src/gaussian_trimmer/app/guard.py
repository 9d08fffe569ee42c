"""Who may talk to the app: this machine alone, and in a browser only the page that the app served itself."""

from __future__ import annotations

import http
import ipaddress
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    Answer = Callable[[ServerConnection, Request], Response | None]

REFUSAL = "This page was requested by another site or under another name; open the address that the program printed."
NO_FRAMES = {"Content-Security-Policy": "frame-ancestors 'none'", "X-Frame-Options": "DENY"}
"""Headers by which a browser refuses to show the app inside another site's page."""


def is_foreign(headers: Mapping[str, str]) -> bool:
    """Whether a request comes from another site.

    A name that is not this machine's was pointed at it by somebody else; and browsers name the site that opens a
    connection, which must be the app itself.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    return not _is_loopback(host) or (origin is not None and urlsplit(origin).netloc.lower() != host.lower())


def guarded(answer: Answer) -> Answer:
    """A function that answers requests, which now refuses other sites and forbids being framed."""

    def check(connection: ServerConnection, request: Request) -> Response | None:
        if is_foreign(request.headers):
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{REFUSAL}\n")
        response = answer(connection, request)
        if response is not None:
            response.headers.update(NO_FRAMES)
        return response

    return check


@contextmanager
def guarding_viser() -> Iterator[list[Answer]]:
    """Guard the server that viser starts meanwhile; gives the list of functions that were guarded.

    viser takes neither a `process_request` nor origins for its server, so the function of websockets with which it
    starts one is wrapped for as long as the start takes.
    """
    import websockets.asyncio.server as servers

    original, guards = servers.serve, list["Answer"]()

    def serve(*arguments: Any, process_request: Answer, **options: Any) -> Any:
        guards.append(guarded(process_request))
        return original(*arguments, process_request=guards[-1], **options)

    servers.serve = serve  # type: ignore[assignment, misc, unused-ignore]
    try:
        yield guards
    finally:
        servers.serve = original  # type: ignore[misc, unused-ignore]


def _is_loopback(host: str) -> bool:
    """Whether a Host header names this machine as only itself can."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
