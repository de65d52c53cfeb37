"""A server for this machine alone: the pages of a finished study, and films of its tests.

It answers only GET, only under its own address (a foreign page that resolves to it has another
Host), and only the listed pages and the films of the study's tests, so that no path reads another
file.
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
"""Text in the file -> text in the served page: films can be requested, fetched and played."""


class ReportServer(ThreadingTCPServer):
    """Serves pages and films; the first page is also at `/`."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, port: int, pages: Mapping[str, Path], films: FilmsOnDemand) -> None:
        """Bind the port.

        Args:
            port: Number of the port; 0 for any free one.
            pages: Address -> file.
            films: Films of the study's tests.

        Raises:
            OSError: The port is taken.
        """
        self.pages, self.films = pages, films
        super().__init__((ADDRESS, port), _Request)

    @property
    def port(self) -> int:
        return int(self.server_address[1])

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print errors, except that a browser closed its connection."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def served(page: Path) -> bytes:
    """A page as it is served.

    Raises:
        InputError: The file is missing, damaged or of another version of the program.
    """
    text = read_bytes(page).decode()
    for stored, instead in SERVED.items():
        if text.count(stored) != 1:
            raise InputError(
                f"{page}: expected a page made by this version of the program; make it again with "
                "./run"
            )
        text = text.replace(stored, instead)
    return text.encode()


class _Request(BaseHTTPRequestHandler):
    server: ReportServer

    def do_GET(self) -> None:
        try:
            path = urlsplit(self.path).path
        except ValueError:  # It is no address.
            path = ""
        port = self.server.port
        if self.headers.get("Host") not in (f"{ADDRESS}:{port}", f"localhost:{port}"):
            sentence = f"This server answers only at http://{ADDRESS}:{port}."
            return self._answer_text(HTTPStatus.FORBIDDEN, sentence)
        try:
            if film := FILM.fullmatch(path):
                return self._film(film[1])
            if page := self.server.pages.get(path):
                return self._answer(HTTPStatus.OK, "text/html; charset=utf-8", served(page))
        except InputError as error:
            return self._answer_text(HTTPStatus.NOT_FOUND, str(error))
        if path == "/":
            first = next(iter(self.server.pages))
            return self._answer(HTTPStatus.FOUND, "text/plain", b"", Location=first)
        self._answer_text(HTTPStatus.NOT_FOUND, "There is no such page.")

    def _film(self, test: str) -> None:
        # A foreign page may name this address, too, and each film takes seconds.
        if self.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            sentence = "Films are made only for the report."
            return self._answer_text(HTTPStatus.FORBIDDEN, sentence)
        film = self.server.films.film(test, self._is_connected)
        if film is not None:
            # Headers are Latin-1.
            changed = {"X-Changed": quote(film.changed)} if film.changed else {}
            self._answer(HTTPStatus.OK, "video/mp4", film.video, **changed)

    def _is_connected(self) -> bool:
        """Whether the client still waits: a page that moves on to another test disconnects."""
        readable = select([self.connection], [], [], 0)[0]
        return not readable or bool(self.connection.recv(1, MSG_PEEK))

    def _answer_text(self, status: HTTPStatus, sentence: str) -> None:
        self._answer(status, "text/plain; charset=utf-8", sentence.encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, **headers: str) -> None:
        self.send_response(status)
        all_headers = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
            **headers,
        }
        for name, value in all_headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: the page shows the outcome of a request."""
