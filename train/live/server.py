"""The server of the live page: loopback only, a token in the address, and no access for other sites' pages.

GET /TOKEN/ is the page, GET /TOKEN/states an endless stream of messages, POST /TOKEN/commands takes one command and
answers with its result.
"""

import hmac
import json
import secrets
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any, cast

from train.live.drive import WorldRunner
from train.live.messages import ALIVE
from train.live.world import MOST_BYTES, read_command
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.render.pages import LivePage

LOOPBACK = "127.0.0.1"
_QUIET = 2.0  # [s] without a message, after which the stream sends a sign of life
_PATIENCE = 20.0  # [s] that a browser may take to read or write


class Server(ThreadingHTTPServer):
    """Serves one page about one runner."""

    daemon_threads = True

    def __init__(self, runner: WorldRunner, page: LivePage, port: int = 0) -> None:
        """port: 0 for a free one. OSError if it is taken."""
        self.runner, self.page, self.token = runner, page, secrets.token_urlsafe(24)
        super().__init__((LOOPBACK, port), Handler)
        self.hosts = {f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost")}

    def server_bind(self) -> None:
        """Take the port, without a lookup of this machine's name."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = LOOPBACK, self.server_address[1]

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that have gone away."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    timeout = _PATIENCE
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Send the page, or the stream."""
        what = self._admitted()
        if what == "":
            self._give(HTTPStatus.OK, self._live.page.text.encode(), "text/html; charset=utf-8")
        elif what == "states":
            self._stream()
        elif what is not None:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")

    def do_POST(self) -> None:
        """Take a command."""
        what = self._admitted()
        if what is None:
            return
        if what != "commands":
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")
            return
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal() and len(length) < 10):
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "a message says how many bytes it has")
        elif int(length) > MOST_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a message has at most {MOST_BYTES:,} bytes")
        elif self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "a message is application/json")
        else:
            self._obey(self.rfile.read(int(length)))

    def _obey(self, message: bytes) -> None:
        try:
            command = read_command(message)
        except WarehouseError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error), close=False)
            return
        try:
            self._live.runner.ask(command)
        except WarehouseError as error:
            self._refuse(HTTPStatus.CONFLICT, str(error), close=False)
            return
        self._give(HTTPStatus.OK, b"{}", "application/json")

    @property
    def _live(self) -> Server:
        return cast(Server, self.server)

    def _admitted(self) -> str | None:
        """Return the path after the token, None if the request was refused.

        Pages of other sites do not know the token, and Host and Origin reveal them. Only the page itself may be opened
        from elsewhere, as by a click on its address.
        """
        live, host, origin = self._live, self.headers.get("Host", ""), self.headers.get("Origin")
        site = self.headers.get("Sec-Fetch-Site", "none")
        _, token, what = (*self.path.split("/", 2), "", "")[:3]
        if host not in live.hosts:
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST, f"this server is {LOOPBACK}, by no other name")
        elif origin not in (None, f"http://{host}") or (what and site not in ("same-origin", "none")):
            self._refuse(HTTPStatus.FORBIDDEN, "pages of other sites may not ask")
        elif not hmac.compare_digest(token.encode("utf-8", "replace"), live.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN, "the address lacks its token; take it from where `warehouse live` runs")
        else:
            return what
        return None

    def _stream(self) -> None:
        """Send messages until the browser leaves or the simulation ends."""
        runner = self._live.runner
        try:
            with runner.listeners.joined() as listener:
                runner.look()
                self.close_connection = True
                self._head(HTTPStatus.OK, "application/octet-stream")
                while not listener.closed:
                    self.wfile.write(listener.take(_QUIET) or ALIVE)
        except ConfigError as error:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, str(error))

    def _refuse(self, status: HTTPStatus, sentence: str, close: bool = True) -> None:
        """Answer with a sentence; close: read nothing more."""
        self.close_connection = self.close_connection or close
        self._give(status, json.dumps({"error": sentence}).encode(), "application/json")

    def _give(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self._head(status, kind, len(body))
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str, length: int | None = None) -> None:
        """Send status and headers; length: of the body, None if it ends with the connection."""
        self.send_response_only(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.send_header("Content-Security-Policy", self._live.page.policy)
        for name, value in (
            ("Cache-Control", "no-store"), ("Referrer-Policy", "no-referrer"), ("X-Content-Type-Options", "nosniff"),
            ("Cross-Origin-Resource-Policy", "same-origin"), ("Cross-Origin-Opener-Policy", "same-origin"),
        ):  # fmt: skip
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Log no requests."""
