"""Serves a viewer's page to this machine's browser, and to nobody else."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from svbrdfgan.errors import ConfigError, SvbrdfganError
from svbrdfgan.viewer.documents import Document, Superseded, Unknown
from svbrdfgan.viewer.page import live_page, live_policy

if TYPE_CHECKING:
    from svbrdfgan.viewer.exhibit import Exhibit

HOST = "127.0.0.1"
_POLICY = f"{live_policy()}; frame-ancestors 'none'"

log = logging.getLogger(__name__)


@dataclass(eq=False)
class _Desk:
    """Answers the requests of one exhibit's pages.

    Attributes:
        token: that every request must name.
        newest: counts the layers that were asked for.
    """

    exhibit: Exhibit
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    newest: int = 0
    _lock: Lock = field(default_factory=Lock)

    def answer(self, path: str) -> Document:
        """The document of a path; `Superseded` if a later one asks for a layer meanwhile."""
        if path == "/":
            return Document("text/html; charset=utf-8", live_page(self.exhibit.title).encode())
        if not path.startswith("/layer/"):
            return self.exhibit.document(path)
        with self._lock:
            self.newest += 1
            mine = self.newest
        return self.exhibit.document(path, lambda: self.newest != mine)


@contextmanager
def serve(exhibit: Exhibit, port: int = 0) -> Iterator[str]:
    """Serves an exhibit for the time of the block, and gives the address, in which the token stands.

    Args:
        port: 0 takes a free one.

    Raises:
        ConfigError: the port is taken.
    """
    try:
        server = _Server(_Desk(exhibit), port)
    except OSError as error:
        raise ConfigError(f"port {port} cannot be used ({error.strerror}); choose another one by --port.") from error
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/?token={server.desk.token}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    """Listens on this machine alone."""

    daemon_threads = True

    def __init__(self, desk: _Desk, port: int) -> None:
        self.desk = desk
        super().__init__((HOST, port), _Handler)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET alone: from this machine, for this server's own page, and with the token. No body is ever read."""

    server: _Server
    server_version, sys_version = "svbrdfgan", ""

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        if refusal := self._refusal(parse_qs(query)):
            self._send(HTTPStatus.FORBIDDEN, Document.of({"error": refusal}))
            return
        try:
            self._send(HTTPStatus.OK, self.server.desk.answer(path))
        except Unknown:
            self._send(HTTPStatus.NOT_FOUND, Document.of({"error": "there is nothing of this name."}))
        except Superseded:
            self._send(HTTPStatus.NO_CONTENT, Document("", b""))
        except SvbrdfganError as error:
            self._send(HTTPStatus.UNPROCESSABLE_ENTITY, Document.of({"error": str(error)}))

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answers what is no request that is known, with the headers of every answer."""
        status = HTTPStatus(code)
        self._send(status, Document.of({"error": f"{message or status.phrase}."}))

    def log_message(self, format: str, *args: object) -> None:
        log.debug(format, *args)

    def _refusal(self, query: dict[str, list[str]]) -> str:
        """Why a request is not answered; empty if it is."""
        own = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        given = self.headers.get("X-Token") or (query.get("token") or [""])[0]
        origins = {None, *(f"http://{name}" for name in own)}
        if self.headers.get("Host") not in own or self.headers.get("Origin") not in origins:
            return "this server answers its own page alone."
        if not secrets.compare_digest(given.encode(), self.server.desk.token.encode()):
            return "the address lacks the token; take the one that the command printed."
        return ""

    def _send(self, status: HTTPStatus, document: Document) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": document.kind,
            "Content-Length": str(len(document.data)),
            "Content-Security-Policy": _POLICY,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        try:
            self.wfile.write(document.data)
        except (BrokenPipeError, ConnectionResetError):
            log.debug("the browser took no interest in %s", self.requestline)
