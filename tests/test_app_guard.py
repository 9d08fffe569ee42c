"""Tests of who may talk to the app, and who may read what it keeps."""

import re
import socket
import stat
import sys
from concurrent.futures import Future
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest

from gaussian_trimmer.app import serving as module
from gaussian_trimmer.app.serving import inner_path, serving
from gaussian_trimmer.errors import InputError

HERE, KEY = {"Host": "127.0.0.1:8080"}, "a-key_1"


@pytest.mark.parametrize(
    ("path", "inner"),
    [(f"/{KEY}/", "/"), (f"/{KEY}", "/"), (f"/{KEY}/a/b?c=d", "/a/b"), (f"/{KEY}?c", "/"), ("/", None), ("", None),
     (f"/{KEY}x/", None), (f"/{KEY[:-1]}/", None), (f"/x/{KEY}/", None), (f"//{KEY}/", None), ("/?" + KEY, None)],
)  # fmt: skip
def test_nothing_is_answered_without_the_key(path, inner):
    assert inner_path(path, HERE, KEY) == inner


@pytest.mark.parametrize(
    ("headers", "foreign"),
    [
        ({"Host": "localhost:8080", "Origin": "http://localhost:8080"}, False),
        ({"Host": "evil.example:8080"}, True),  # a name that was pointed at this machine
        ({}, True),
        ({**HERE, "Origin": "http://evil.example"}, True),
        ({**HERE, "Origin": "http://127.0.0.1:9999"}, True),
        ({**HERE, "Origin": "null"}, True),
    ],
)
def test_only_this_machines_own_pages_are_answered(headers, foreign):
    assert (inner_path(f"/{KEY}/", headers, KEY) is None) == foreign


UPGRADE = (
    "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol: viser-v0",
)  # fmt: skip


def answer(address, path, *headers):
    """Status and bytes that come back for what is written to a plain socket."""
    host = urlsplit(address).netloc
    with socket.create_connection(("127.0.0.1", urlsplit(address).port), timeout=20) as wire:
        wire.sendall("\r\n".join([f"GET {path} HTTP/1.1", f"Host: {host}", *headers, "", ""]).encode())
        data = b""
        while b"\r\n\r\n" not in data and (chunk := wire.recv(1 << 16)):
            data += chunk
        if b" 101 " not in data.partition(b"\r\n")[0]:  # a socket stays open
            while chunk := wire.recv(1 << 16):
                data += chunk
    return int(data.split()[1]), data


@pytest.mark.needs("viser")
def test_who_has_no_key_gets_nothing_of_the_app(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(module.webbrowser, "open", opened.append)
    with serving(None, None, port=0, state=tmp_path / "state") as app:
        path = urlsplit(app.address).path
        assert re.fullmatch(r"/[\w-]{32}/", path)
        status, page = answer(app.address, path)
        assert status == 200 and b"viser" in page
        assert all(header in page for header in (b"frame-ancestors 'none'", b"X-Frame-Options: DENY", b"no-referrer"))
        assert answer(app.address, path, *UPGRADE)[0] == 101
        assert answer(app.address, path + "../../etc/passwd")[0] == 404
        for wrong in ("/", "/index.html", path[:-2] + "/", f"/x{path}", f"/?{path}"):
            for headers in ((), UPGRADE):
                status, page = answer(app.address, wrong, *headers)
                assert status == 403 and b"viser" not in page.lower() and len(page) < 500
        assert answer(app.address, path, "Origin: http://evil.example", *UPGRADE)[0] == 403
        assert app.server.get_clients() == {}
        app.open_browser()
        (uri,) = opened
        assert path not in uri and app.address in app.page.read_text()  # other users see what programs start with
        assert stat.S_IMODE(app.page.stat().st_mode) == 0o600
        assert stat.S_IMODE((tmp_path / "state").stat().st_mode) == 0o700
    assert not app.page.exists()
    with serving(None, None, port=0, state=tmp_path / "state") as other:
        assert urlsplit(other.address).path != path


@pytest.mark.needs("viser")
def test_a_server_that_cannot_be_guarded_does_not_start(monkeypatch, tmp_path):

    @contextmanager
    def nothing(key):
        yield []

    monkeypatch.setattr(module, "guarding_viser", nothing)
    with pytest.raises(InputError, match="cannot be guarded"), serving(None, None, port=0, state=tmp_path):
        pass


@pytest.mark.needs("viser")
def test_no_client_opens_a_tunnel(monkeypatch, tmp_path):
    import viser
    from viser import _messages

    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_: pytest.fail("viser was asked for a tunnel"))
    with serving(None, None, port=0, state=tmp_path) as app:
        asked = []
        monkeypatch.setattr(app.server._thread_executor, "submit", lambda call: asked.append(call()) or Future())
        for handle in app.server._websock_server._incoming_handlers[_messages.ShareUrlRequest]:
            handle(0, _messages.ShareUrlRequest())
    assert asked[0] is None


@pytest.mark.needs("viser")
def test_a_home_that_cannot_be_written_is_said_with_the_cure(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="set XDG_STATE_HOME"), serving(None, None, state=tmp_path / "file" / "state"):
        pass


def test_without_viser_the_cure_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"pip install .*\[app\]"), serving(None, None, port=0):
        pass
