"""The server answers this machine's browser, on its own page, with the token, and nobody else."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
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


def raw_answer(address: str, *lines: str) -> tuple[int, bytes]:
    """The status and the body that answer lines which no decent client would send."""
    port = urlsplit(address).port or 0
    with socket.create_connection((HOST, port), timeout=60) as connection:
        connection.sendall("\r\n".join([*lines, f"Host: {HOST}:{port}", "", ""]).encode("latin-1"))
        head, _, body = b"".join(iter(lambda: connection.recv(2**16), b"")).partition(b"\r\n\r\n")
    return int(head.split()[1]), body


def test_the_page_comes_by_the_address_alone(address: str) -> None:
    response, page = answer(address, f"/?token={token_of(address)}")
    assert response.status == 200
    assert b"white &lt;van&gt;.glb" in page


@pytest.mark.parametrize(
    ("path", "method"),
    [
        ("/?token=TOKEN", "GET"),
        ("/state?token=TOKEN", "GET"),
        ("/", "GET"),
        ("/none?token=TOKEN", "GET"),
        ("/", "POST"),
    ],
)
def test_every_answer_is_guarded(address: str, path: str, method: str) -> None:
    response, _ = answer(address, path.replace("TOKEN", token_of(address)), method)
    assert response.getheader("X-Content-Type-Options") == "nosniff"
    assert response.getheader("Referrer-Policy") == "no-referrer"
    assert response.getheader("Cache-Control") == "no-store"
    policy = response.getheader("Content-Security-Policy") or ""
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize("path", ["/", "/state", "/?token=", "/?token=wrong", "/?token=%C3%A9", "/model/0"])
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


@pytest.mark.parametrize(
    "origin",
    [
        "https://example.com",
        "null",
        "http://127.0.0.1:1",
        "https://127.0.0.1:PORT",
        "http://127.0.0.1:PORT/",
        "http://[",
    ],
)
def test_pages_of_others_get_nothing(address: str, origin: str) -> None:
    own = origin.replace("PORT", str(urlsplit(address).port))
    response, _ = answer(address, "/state", X_Token=token_of(address), Origin=own)
    assert response.status == 403


@pytest.mark.parametrize("host", ["example.com", "example.com:PORT", "127.0.0.1", "127.0.0.1:1", "localhost.:PORT", ""])
def test_a_name_that_was_rebound_to_this_machine_gets_nothing(address: str, host: str) -> None:
    rebound = host.replace("PORT", str(urlsplit(address).port))
    response, _ = answer(address, "/state", X_Token=token_of(address), Host=rebound)
    assert response.status == 403


def test_localhost_is_this_machine_too(address: str) -> None:
    response, _ = answer(address, "/state", X_Token=token_of(address), Host=f"localhost:{urlsplit(address).port}")
    assert response.status == 200


@pytest.mark.parametrize(
    "path",
    [
        *("/nothing", "/static/viewer.js", "/layer/0/0/0/50/1", "/layer/0/0/-1/50/512", "/model/-1", "/light/99"),
        *(
            "/../server.py",
            "/..%2f..%2fserver.py",
            "/%2e%2e/server.py",
            "/model/../state",
            "/model/0/..",
            "/..\\server.py",
        ),
        *("/etc/passwd", "//etc/passwd", "/%2fetc%2fpasswd", "/model/%2fetc%2fpasswd", "file:///etc/passwd"),
        *("/model/0%00", "/state%00.json", "/model/\x00", "/white%20%3Cvan%3E.glb", "/link.glb", "http://[/state"),
    ],
)
def test_nothing_else_is_served(address: str, van: Path, path: str) -> None:
    if not (link := van.with_name("link.glb")).exists():
        link.symlink_to(van)
    status, body = raw_answer(address, f"GET {path} HTTP/1.1", f"X-Token: {token_of(address)}")
    assert status == 404
    assert json.loads(body) == {"error": "there is nothing of this name."}


def test_bodies_are_not_read(address: str) -> None:
    length, token = f"Content-Length: {10**15}", f"X-Token: {token_of(address)}"
    assert raw_answer(address, "GET /state HTTP/1.1", token, length)[0] == 200
    assert raw_answer(address, "POST /state HTTP/1.1", token, length)[0] == 501


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
    assert set(found.values()) <= {200, 204}
    assert 204 in found.values()


def test_only_this_machine_is_listened_to(address: str) -> None:
    port = urlsplit(address).port
    named = {str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), port, socket.AF_INET)}
    for other in named - {HOST} | {"127.0.0.2"}:  # where Linux would answer, too, if all addresses were listened to
        with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
            socket.create_connection((other, port or 0), timeout=2)
    assert urlsplit(address).hostname == HOST


def test_a_port_that_is_taken_is_said(exhibit: Exhibit, address: str) -> None:
    port = urlsplit(address).port or 0
    with pytest.raises(ConfigError, match=f"port {port} cannot be used"), serve(exhibit, port):
        pass
