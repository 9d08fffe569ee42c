"""Tests of who may talk to the app, and who may read what it keeps."""

import hmac
import os
import re
import socket
import stat
import sys
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest

from gaussian_trimmer.app import serving as module
from gaussian_trimmer.app.serving import inner_path, serving
from gaussian_trimmer.errors import InputError

HERE, KEY = {"host": "127.0.0.1:8080"}, "a-key_1"


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
        ({"host": "localhost:8080", "origin": "http://localhost:8080"}, False),
        ({"host": "evil.example:8080"}, True),  # a name that was pointed at this machine
        ({}, True),
        ({**HERE, "origin": "http://evil.example"}, True),
        ({**HERE, "origin": "http://127.0.0.1:9999"}, True),
        ({**HERE, "origin": "null"}, True),
    ],
)
def test_only_this_machines_own_pages_are_answered(headers, foreign):
    assert (inner_path(f"/{KEY}/", headers, KEY) is None) == foreign


UPGRADE = (
    "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
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


@pytest.mark.needs("starlette")
def test_the_program_proves_that_it_has_the_key_before_a_tab_sends_it_again(tmp_path):
    nonce = "0123456789abcdef" * 2
    with serving(None, None, port=0, state=tmp_path / "state") as app:
        key = urlsplit(app.address).path.strip("/")
        status, said = answer(app.address, f"/proof/{nonce}")
        assert status == 200 and said.endswith(hmac.digest(key.encode(), nonce.encode(), "sha256"))
        assert key.encode() not in said
        assert answer(app.address, f"/proof/{nonce[1:]}")[0] == 403
        assert answer(app.address, f"/proof/{nonce}", "Origin: http://elsewhere.org")[0] == 403


@pytest.mark.needs("starlette")
def test_who_has_no_key_gets_nothing_of_the_app(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(module.webbrowser, "open", opened.append)
    with serving(None, None, port=0, state=tmp_path / "state") as app:
        path = urlsplit(app.address).path
        assert re.fullmatch(r"/[\w-]{32}/", path)
        status, page = answer(app.address, path)
        assert status == 200 and b"GaussianTrimmer" in page
        headers = b"frame-ancestors 'none'", b"default-src 'self'", b"DENY", b"no-referrer", b"no-store", b"nosniff"
        assert all(header in page for header in headers)
        assert answer(app.address, path + "socket", *UPGRADE)[0] == 101
        for nothing in ("../../etc/passwd", "assets/../serving.py", "assets/%2e%2e%2fserving.py", "file/x", "layer/1"):
            assert answer(app.address, path + nothing)[0] == 404
        for wrong in ("/", "/index.html", path[:-2] + "/", f"/x{path}", f"/?{path}", f"{path[:-2]}/socket"):
            for headers in ((), UPGRADE):
                status, page = answer(app.address, wrong, *headers)
                assert status == 403 and b"canvas" not in page.lower() and len(page) < 700
        assert answer(app.address, path + "socket", "Origin: http://evil.example", *UPGRADE)[0] == 403
        app.open_browser()
        (uri,) = opened
        assert path not in uri and app.address in app.page.read_text()  # other users see what programs start with
        assert stat.S_IMODE(app.page.stat().st_mode) == 0o600
        assert stat.S_IMODE((tmp_path / "state").stat().st_mode) == 0o700
    assert not app.page.exists()
    with serving(None, None, port=0, state=tmp_path / "state") as other:
        assert urlsplit(other.address).path != path


def free_port():
    with socket.socket() as wire:
        wire.bind(("127.0.0.1", 0))
        return wire.getsockname()[1]


@pytest.mark.needs("starlette")
def test_the_key_is_kept_for_the_port_so_that_a_tab_comes_back(tmp_path):
    port, addresses = free_port(), []
    for state in (tmp_path, tmp_path, tmp_path / "other"):
        with serving(None, None, port=port, state=state) as app:
            addresses.append(app.address)
            with serving(None, None, port=port, state=state) as beside:  # the port is taken
                assert urlsplit(beside.address).port > port
    assert addresses[0] == addresses[1] != addresses[2]
    (kept,) = tmp_path.glob(f"key-{port}")
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    kept.write_text("guessed")
    with serving(None, None, port=port, state=tmp_path) as app:
        assert "guessed" not in app.address


@pytest.mark.needs("starlette")
def test_files_are_sent_by_http_whole_and_under_their_own_names(tmp_path):
    with serving(None, None, port=0, state=tmp_path) as app:
        request = Request(f"{app.address}upload/my%20file.npy?tab=1", b"nonsense", method="POST")
        assert urlopen(request).status == 204
        (stored,) = (tmp_path / "files").glob("*/*")
        assert stored.name == "my file.npy" and stored.read_bytes() == b"nonsense"
        assert app.controller.panels.status_text == "Open a scene first."
        old = tmp_path / "files" / "0" / "old.ply"
        old.parent.mkdir()
        old.touch()
        os.utime(old, (0, 0))
        urlopen(request)
        assert not old.exists() and stored.exists()  # of another week


@pytest.mark.needs("starlette")
def test_with_a_home_that_cannot_be_written_the_app_starts_and_says_that_nothing_is_kept(tmp_path):
    (tmp_path / "file").touch()
    with serving(None, None, port=0, state=tmp_path / "file" / "state") as app:
        assert "set XDG_STATE_HOME" in app.controller.panels.status_text
        assert answer(app.address, urlsplit(app.address).path)[0] == 200


def test_without_the_extra_the_cure_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(InputError, match=r"pip install .*\[app\]"), serving(None, None, port=0):
        pass
