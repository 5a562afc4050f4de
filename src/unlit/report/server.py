"""A result's report over HTTP, for this machine only.

A file opened from disk would do for the report; some browsers refuse such files, and remote
desktops forward ports more easily than files. The server listens on the loopback interface,
answers GET and HEAD for the names of a result and nothing else, and refuses requests that a
foreign page's name was made to point here for (DNS rebinding).
"""

from __future__ import annotations

import os
from collections.abc import Collection
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from shutil import copyfileobj

from ..errors import OutputError
from ..output.save import RESULT_FILES
from ..storage.folder import REPORT

HOST = "127.0.0.1"
#: What may be asked for, besides / for the report.
SERVED = RESULT_FILES

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".png": "image/png",
    ".json": "application/json",
    ".glb": "model/gltf-binary",
    ".toml": "text/plain; charset=utf-8",
    ".log": "text/plain; charset=utf-8",
}
# The report has a policy of its own, too; this one holds for every file.
_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class ReportServer(ThreadingHTTPServer):
    """Serves the result in `folder` on `port`, 0 for one that is free. Raises OutputError."""

    daemon_threads = True
    allow_reuse_address = os.name != "nt"  # on Windows it would share a port that is in use

    def __init__(self, folder: Path, port: int = 0, names: Collection[str] = SERVED) -> None:
        self.folder = folder.resolve()
        self.names = frozenset(names)
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise OutputError(
                f"port {port}: cannot be used ({getattr(error, 'strerror', None) or error}); "
                "choose another, or 0 for any that is free"
            ) from error

    @property
    def address(self) -> str:
        """Where the report is."""
        return f"http://{HOST}:{self.server_port}/"


class _Handler(BaseHTTPRequestHandler):
    server: ReportServer  # type: ignore[assignment]
    server_version, sys_version = "unlit", ""
    timeout = 30

    def do_GET(self) -> None:
        self._answer(body=True)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def _answer(self, body: bool) -> None:
        # A page elsewhere that has its name resolve to this machine still sends its own name.
        if self.headers.get("Host", "").partition(":")[0] not in (HOST, "localhost"):
            return self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
        # The name must be one of the list as it stands: nothing is decoded, joined or resolved.
        name = self.path.partition("?")[0].removeprefix("/") or REPORT
        path = self.server.folder / name if name in self.server.names else None
        if path is None or path.is_symlink() or not path.is_file():
            return self.send_error(HTTPStatus.NOT_FOUND)
        with path.open("rb") as file:
            self.send_response(HTTPStatus.OK)
            kind = _TYPES.get(path.suffix, "application/octet-stream")
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(os.fstat(file.fileno()).st_size))
            self.end_headers()
            if body:
                copyfileobj(file, self.wfile)
        return None

    def end_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not worth a line."""
