"""Tests of who may talk to the app."""

import urllib.error
import urllib.request

import pytest

from gaussian_trimmer.app.guard import refusal

TOKEN = "s3cret"
HERE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        (HERE, True),
        ({"Host": "localhost:8080", "Origin": "http://localhost:8080"}, True),
        ({"Host": "[::1]:8080"}, True),
        ({"Host": "evil.example:8080"}, False),  # a name that was pointed at this machine
        ({}, False),
        ({**HERE, "Origin": "http://evil.example"}, False),
        ({**HERE, "Origin": "http://127.0.0.1:9999"}, False),
        ({**HERE, "Origin": "null"}, False),
        ({"Host": "]["}, False),
    ],
)
def test_without_a_token_only_this_machines_own_pages_are_answered(headers, allowed):
    assert (refusal("/", headers, "") == "") == allowed


@pytest.mark.parametrize(
    ("path", "cookie", "allowed"),
    [
        (f"/?token={TOKEN}", "", True),
        ("/", "", False),
        ("/?token=", "", False),
        ("/?token=wrong", "", False),
        ("/?token=%ff", "", False),
        ("/", "{name}=s3cret", True),
        ("/", "{name}=wrong", False),
        ("/", "other=s3cret", False),
        ("/", "a=b; {name}=s3cret; c=d", True),
        ("/", "\x00;;==;", False),
    ],
)
def test_from_elsewhere_the_token_is_needed(path, cookie, allowed):
    from gaussian_trimmer.app.guard import _cookie

    headers = {"Host": "workstation.example:8080", "Cookie": cookie.format(name=_cookie(TOKEN))}
    assert (refusal(path, headers, TOKEN) == "") == allowed
    assert refusal(path, {**headers, "Origin": "http://evil.example"}, TOKEN) != ""


def get(address, **headers):
    """Status and text of a page, redirections followed with cookies."""
    from http.cookiejar import CookieJar

    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
    try:
        with opener.open(urllib.request.Request(address, headers=headers), timeout=20) as answer:
            return answer.status, answer.read().decode("utf-8", "replace"), answer.geturl()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), address


def test_the_running_app_answers_those_whom_it_should():
    pytest.importorskip("viser", reason="needs viser: the app extra")
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0) as app:
        assert get(app.address)[0] == 200
        status, text, _ = get(app.address, Host="evil.example")
        assert status == 403
        assert "another name" in text
        assert get(app.address, Origin="http://evil.example")[0] == 403
    with serving(None, None, host="0.0.0.0", port=0) as app:
        port_and_token = app.address.split(":")[2]
        whole = f"http://127.0.0.1:{port_and_token}"
        status, text, place = get(whole)
        assert status == 200
        assert "token" not in place  # it is a cookie now
        status, text, _ = get(whole.split("?")[0])
        assert status == 403
        assert "needs its token" in text


def test_a_websocket_needs_the_token_too():
    pytest.importorskip("viser", reason="needs viser: the app extra")
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    from gaussian_trimmer.app.serving import serving

    with serving(None, None, host="0.0.0.0", port=0) as app:
        port, _, token = app.address.split(":")[2].partition("/?token=")
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{port}/", subprotocols=["viser-v0"])
        with connect(f"ws://127.0.0.1:{port}/?token={token}", subprotocols=["viser-v0"]):
            pass  # viser itself then refuses another version


def test_a_server_that_cannot_be_guarded_does_not_start(monkeypatch):
    pytest.importorskip("viser", reason="needs viser: the app extra")
    from contextlib import contextmanager

    from gaussian_trimmer.app import serving as module
    from gaussian_trimmer.errors import InputError

    @contextmanager
    def nothing(token):
        yield []

    monkeypatch.setattr(module, "guarding", nothing)
    with pytest.raises(InputError, match="cannot be guarded"), module.serving(None, None, port=0):
        pass


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid", "", "a" * 99])
def test_an_address_of_another_machine_is_refused_at_once(host):
    pytest.importorskip("viser", reason="needs viser: the app extra")
    from gaussian_trimmer.app.serving import serving
    from gaussian_trimmer.errors import InputError

    with pytest.raises(InputError, match="Cannot listen"), serving(None, None, host=host, port=0):
        pass


def test_without_viser_the_cure_is_said(monkeypatch):
    import sys

    from gaussian_trimmer.app.serving import serving
    from gaussian_trimmer.errors import InputError

    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"pip install .*\[app\]"), serving(None, None, port=0):
        pass
