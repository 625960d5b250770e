"""The server answers this machine's browser, on its own page, with the token, and nobody else."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from http.client import HTTPConnection, HTTPResponse
from threading import Thread
from urllib.parse import parse_qs, urlsplit

import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.server import HOST, serve


@pytest.fixture(scope="module")
def address(exhibit: Exhibit) -> Iterator[str]:
    with serve(exhibit) as address:
        yield address


def token_of(address: str) -> str:
    return parse_qs(urlsplit(address).query)["token"][0]


def answer(address: str, path: str, method: str = "GET", **headers: str) -> tuple[HTTPResponse, bytes]:
    connection = HTTPConnection(HOST, urlsplit(address).port or 0, timeout=60)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    response = connection.getresponse()
    return response, response.read()


def test_the_page_comes_by_the_address_alone(address: str) -> None:
    response, page = answer(address, f"/?token={token_of(address)}")
    assert response.status == 200
    assert b"white &lt;van&gt;.glb" in page
    assert "default-src 'none'" in (response.getheader("Content-Security-Policy") or "")
    assert response.getheader("Cache-Control") == "no-store"


@pytest.mark.parametrize("path", ["/", "/state", "/?token=", "/?token=wrong", "/model/0"])
def test_without_the_token_there_is_nothing(address: str, path: str) -> None:
    response, body = answer(address, path)
    assert response.status == 403
    assert "token" in json.loads(body)["error"]


def test_documents_come_with_the_token(address: str) -> None:
    response, body = answer(address, "/state", X_Token=token_of(address))
    assert response.status == 200
    assert json.loads(body)["title"] == "white <van>.glb"
    response, body = answer(address, "/light/0", X_Token=token_of(address), Origin=address.partition("/?")[0])
    assert response.status == 200
    assert len(body) == int(response.getheader("Content-Length") or 0) > 1000


@pytest.mark.parametrize("origin", ["https://example.com", "null", "http://127.0.0.1:1"])
def test_pages_of_others_get_nothing(address: str, origin: str) -> None:
    response, _ = answer(address, "/state", X_Token=token_of(address), Origin=origin)
    assert response.status == 403


def test_a_name_that_was_rebound_to_this_machine_gets_nothing(address: str) -> None:
    response, _ = answer(address, "/state", X_Token=token_of(address), Host="example.com")
    assert response.status == 403


@pytest.mark.parametrize("path", ["/nothing", "/static/viewer.js", "/../server.py", "/layer/0/0/0/50/1"])
def test_nothing_else_is_served(address: str, path: str) -> None:
    response, _ = answer(address, path, X_Token=token_of(address))
    assert response.status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_only_reading_is_possible(address: str, method: str) -> None:
    response, _ = answer(address, "/state", method, X_Token=token_of(address))
    assert response.status == 501


def test_a_newer_layer_supersedes_an_older(exhibit: Exhibit, address: str) -> None:
    dust = next(k for k, choice in enumerate(exhibit.pieces[0].choices) if choice.label == "Dust")
    found: dict[int, int] = {}

    def ask(percent: int) -> None:
        path = f"/layer/0/{dust}/5/{percent}/{exhibit.fine}"
        found[percent] = answer(address, path, X_Token=token_of(address))[0].status

    threads = [Thread(target=ask, args=[percent]) for percent in (10, 20, 30, 40)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found.values()).count(200) >= 1
    assert set(found.values()) <= {200, 409}
    assert 409 in found.values()


def test_only_this_machine_is_listened_to(address: str) -> None:
    port = urlsplit(address).port
    others = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), port, socket.AF_INET)}
    for other in others - {HOST}:
        if not str(other).startswith("127."):
            with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
                socket.create_connection((str(other), port or 0), timeout=2)
    assert urlsplit(address).hostname == HOST


def test_a_port_that_is_taken_is_said(exhibit: Exhibit, address: str) -> None:
    port = urlsplit(address).port or 0
    with pytest.raises(ConfigError, match=f"port {port} cannot be used"), serve(exhibit, port):
        pass
