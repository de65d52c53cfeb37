"""A server for this machine alone: the pages of a finished study, and films of its tests.

It answers only GET, only under its own address (a foreign page that resolves to it has another Host), and only the listed pages and the
films of tests that the study has, so that no path reads another file.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from select import select
from socket import MSG_PEEK
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import quote, urlsplit

from pipeline.artefacts.files import read_bytes
from pipeline.errors import InputError
from pipeline.report.films_on_demand import FilmsOnDemand

ADDRESS = "127.0.0.1"
FILM = re.compile(r"/films/([\w-]+)\.mp4", re.ASCII)
SERVED = {
    '<html lang="en">': '<html lang="en" data-served>',
    "media-src data:;": "media-src data: blob:; connect-src 'self';",
}
"""What the served page has in place of the file's text: a mark that films can be had, and the right to fetch and play them."""


class ReportServer(ThreadingTCPServer):
    """Serves pages (address -> file) and films; the first page is also at `/`. OSError if the port is taken."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, port: int, pages: Mapping[str, Path], films: FilmsOnDemand) -> None:
        self.pages, self.films = pages, films
        super().__init__((ADDRESS, port), _Request)

    @property
    def port(self) -> int:
        return int(self.server_address[1])

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves is no error."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def served(page: Path) -> bytes:
    """A page as it is served; InputError if it is missing, damaged or made by another version of the program."""
    text = read_bytes(page).decode()
    for stored, instead in SERVED.items():
        if text.count(stored) != 1:
            raise InputError(
                f"{page}: expected a page made by this version of the program; make it again with ./run"
            )
        text = text.replace(stored, instead)
    return text.encode()


def _path(target: str) -> str:
    """The path that a request asks for; empty if it is no address."""
    try:
        return urlsplit(target).path
    except ValueError:
        return ""


class _Request(BaseHTTPRequestHandler):
    server: ReportServer

    def do_GET(self) -> None:
        path = _path(self.path)
        if self.headers.get("Host") not in [
            f"{name}:{self.server.port}" for name in (ADDRESS, "localhost")
        ]:
            return self._say(
                HTTPStatus.FORBIDDEN,
                f"This server answers only at http://{ADDRESS}:{self.server.port}.",
            )
        try:
            if film := FILM.fullmatch(path):
                return self._film(film[1])
            if page := self.server.pages.get(path):
                return self._answer(HTTPStatus.OK, "text/html; charset=utf-8", served(page))
        except InputError as error:
            return self._say(HTTPStatus.NOT_FOUND, str(error))
        if path == "/":
            return self._answer(
                HTTPStatus.FOUND, "text/plain", b"", Location=next(iter(self.server.pages))
            )
        self._say(HTTPStatus.NOT_FOUND, "There is no such page.")

    def _film(self, test: str) -> None:
        # A foreign page may name this address, too, and each film takes seconds.
        if self.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return self._say(HTTPStatus.FORBIDDEN, "Films are made only for the report.")
        film = self.server.films.film(test, self._waits)
        if film is not None:
            # A header holds Latin letters only.
            self._answer(
                HTTPStatus.OK,
                "video/mp4",
                film.video,
                **({"X-Changed": quote(film.changed)} if film.changed else {}),
            )

    def _waits(self) -> bool:
        """Whether the other end still waits: a page that goes on to another test hangs up."""
        return not select([self.connection], [], [], 0)[0] or bool(
            self.connection.recv(1, MSG_PEEK)
        )

    def _say(self, status: HTTPStatus, sentence: str) -> None:
        self._answer(status, "text/plain; charset=utf-8", sentence.encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, **headers: str) -> None:
        own = {
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            **own,
            **headers,
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the page tells what becomes of a request."""
