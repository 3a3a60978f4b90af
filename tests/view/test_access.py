"""The checks of the token and of the headers Host and Origin."""

import pytest

from jotlight.view.access import (
    accepts_host,
    accepts_origin,
    accepts_token,
    cookie_token,
    is_loopback,
    names_of,
)

LOCAL = names_of("127.0.0.1")


@pytest.mark.parametrize(
    "header", ["127.0.0.1", "127.0.0.1:8000", "localhost:1", "LOCALHOST:80", "[::1]:8000"]
)
def test_names_of_this_machine_are_accepted_with_any_port(header):
    assert accepts_host(header, LOCAL, any_address=False)


@pytest.mark.parametrize(
    "header",
    [
        *(None, "", "evil.example", "evil.example:8000", "127.0.0.1.evil.example"),
        *("localhost.evil.example", "evil.example#localhost", "evil.example/localhost"),
        *("a@localhost", "localhost:port", "192.168.1.2:8000", "127.0.0.1:8000, evil.example"),
        *("[::1", "[evil]:1", "localhost\\evil"),
    ],
)
def test_other_names_are_refused(header):
    assert not accepts_host(header, LOCAL, any_address=False)


def test_a_public_server_accepts_addresses_but_not_the_names_of_others():
    public = names_of("0.0.0.0")
    assert accepts_host("192.168.1.2:8000", public, any_address=True)
    assert not accepts_host("evil.example:8000", public, any_address=True)


@pytest.mark.parametrize(
    "origin",
    ["null", "http://evil.example", "http://localhost:9", "file://", "http://localhost:8000/", ""],
)
def test_other_origins_are_refused(origin):
    assert not accepts_origin(origin, "localhost:8000", required=False)


def test_a_websocket_needs_an_origin():
    assert not accepts_origin(None, "localhost:8000", required=True)
    assert accepts_origin("http://LOCALHOST:8000", "localhost:8000", required=True)


@pytest.mark.parametrize("given", [None, "", "secre", "secret ", "sécret", "secret\0"])
def test_only_the_whole_token_is_accepted(given):
    assert accepts_token("secret", "secret")
    assert not accepts_token(given, "secret")


@pytest.mark.parametrize("header", [None, "", "=;;,", "other=1", "jotlight-1"])
def test_cookies_of_others_hold_no_token(header):
    assert cookie_token(header, "jotlight-1") is None


def test_loopback_is_recognized():
    assert [is_loopback(host) for host in ("127.9.9.9", "::1", "localhost")] == [True] * 3
    assert [is_loopback(host) for host in ("0.0.0.0", "::", "example.org", "")] == [False] * 4
