"""Who may talk to the app: pages that it served itself and, from other machines, whoever has the token."""

from __future__ import annotations

import hashlib
import hmac
import http
import ipaddress
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    Answer = Callable[[ServerConnection, Request], Response | None]

_FOREIGN = "This page was asked for by another name or by another site; open the address that the program printed."
_NO_TOKEN = "This app needs its token; open the whole address that the program printed."


def is_loopback(host: str) -> bool:
    """Whether a host's name or address can be reached from its own machine alone.

    >>> [is_loopback(host) for host in ("localhost", "127.0.0.1", "::1", "0.0.0.0", "example.org")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def refusal(path: str, headers: Any, token: str) -> str:
    """Why a request is refused; empty if it is not.

    Without a token the app is for its own machine: requests by other names come from sites that have pointed their name
    at it. Browsers name the site that opens a connection, and it must be this one.

    Args:
        path: of the request, with its query.
        headers: of the request, by name.
        token: what those from other machines must know; empty if there are none.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if not token and not is_loopback(_name(host)):
        return _FOREIGN
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return _FOREIGN
    if token and not any(_same(given, token) for given in (_in_query(path), _in_cookie(headers, token))):
        return _NO_TOKEN
    return ""


def guarded(answer: Answer, token: str) -> Answer:
    """A server's function that answers requests, which now refuses some, and takes the token out of the address."""

    def check(connection: ServerConnection, request: Request) -> Response | None:
        reason = refusal(request.path, request.headers, token)
        if reason:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
        is_page = request.headers.get("Upgrade", "").lower() != "websocket"
        if token and is_page and _same(_in_query(request.path), token):
            response = connection.respond(http.HTTPStatus.SEE_OTHER, "")
            response.headers["Location"] = "/"
            response.headers["Set-Cookie"] = f"{_cookie(token)}={token}; Path=/; HttpOnly; SameSite=Lax"
            return response
        return answer(connection, request)

    return check


@contextmanager
def guarding(token: str) -> Iterator[list[str]]:
    """Guard all websocket servers that begin to listen meanwhile; gives the list of those that did.

    viser has no place for such a check, so the function that it starts its server with is wrapped.
    """
    import websockets.asyncio.server as servers

    original, started = servers.serve, list[str]()

    def serve(*arguments: Any, **options: Any) -> Any:
        options["process_request"] = guarded(options["process_request"], token)
        started.append(f"{arguments[1:3]}")
        return original(*arguments, **options)

    servers.serve = serve  # type: ignore[assignment, misc, unused-ignore]
    try:
        yield started
    finally:
        servers.serve = original  # type: ignore[misc, unused-ignore]


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _in_query(path: str) -> str:
    return (parse_qs(urlsplit(path).query).get("token") or [""])[0]


def _in_cookie(headers: Any, token: str) -> str:
    try:
        cookie = SimpleCookie(headers.get("Cookie", "")).get(_cookie(token))
    except CookieError:
        return ""
    return cookie.value if cookie else ""


def _cookie(token: str) -> str:
    """Name of the cookie: that of other apps on the same machine must not replace it."""
    return f"gaussian-trimmer-{hashlib.sha256(token.encode()).hexdigest()[:8]}"


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
