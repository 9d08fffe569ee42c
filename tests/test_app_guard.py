"""Tests of who may talk to the app."""

import sys
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

from gaussian_trimmer.app import serving as module
from gaussian_trimmer.app.guard import is_foreign
from gaussian_trimmer.app.serving import serving
from gaussian_trimmer.errors import InputError

HERE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("headers", "foreign"),
    [
        (HERE, False),
        ({"Host": "localhost:8080", "Origin": "http://localhost:8080"}, False),
        ({"Host": "evil.example:8080"}, True),  # a name that was pointed at this machine
        ({}, True),
        ({**HERE, "Origin": "http://evil.example"}, True),
        ({**HERE, "Origin": "http://127.0.0.1:9999"}, True),
    ],
)
def test_only_this_machines_own_pages_are_answered(headers, foreign):
    assert is_foreign(headers) == foreign


def get(address, **headers):
    """Status, headers and text of a page."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=20) as answer:
            return answer.status, answer.headers, answer.read().decode("utf-8", "replace")
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read().decode()


@pytest.mark.needs("viser")
def test_the_running_app_refuses_other_sites_and_their_frames():
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with serving(None, None, port=0) as app:
        assert app.address.startswith("http://127.0.0.1:")
        status, headers, _ = get(app.address)
        assert status == 200
        assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        assert headers["X-Frame-Options"] == "DENY"
        status, _, text = get(app.address, Host="evil.example")
        assert status == 403 and "another site" in text
        websocket = app.address.replace("http", "ws")
        with pytest.raises(InvalidStatus, match="403"):
            connect(websocket, origin="http://evil.example", subprotocols=["viser-v0"])
        with connect(websocket, subprotocols=["viser-v0"]):
            pass  # viser itself then refuses another version


@pytest.mark.needs("viser")
def test_a_server_that_cannot_be_guarded_does_not_start(monkeypatch):

    @contextmanager
    def nothing():
        yield []

    monkeypatch.setattr(module, "guarding_viser", nothing)
    with pytest.raises(InputError, match="cannot be guarded"), serving(None, None, port=0):
        pass


def test_without_viser_the_cure_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"pip install .*\[app\]"), serving(None, None, port=0):
        pass
