# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The server of the page, in a thread of its own.

Tornado on an event loop that also hears the topics: ten times a second it takes what has come,
and sends a frame to every browser that has taken its last one.  Nothing is queued for a browser,
so a slow one costs nothing; more of them than `MOST_BROWSERS` are turned away.

Who may look at the page, and who may press its stop.

Looking needs no token: the server is bound to this machine's own address unless somebody asks for
another.  A page of another site is kept out by the name that it has to use (``Host``, against
names that are made to point here) and by where it comes from (``Origin``).  Pressing needs the
token, in a header that no foreign page can send without being asked first.
"""

import asyncio
import hmac
import ipaddress
import json
import socket
import stat
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rpms_ros.errors import LiveError
from rpms_ros.live.live_session import Cursor, LiveSession

SHORTEST_TOKEN = 16
_LONGEST_TOKEN = 200
_SCHEME = 'Bearer '

# Sent with every answer: nothing from elsewhere, in no frame, kept by nobody.
_HEADERS: Mapping[str, str] = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cache-Control': 'no-store',
}


@dataclass(frozen=True)
class Access:
    """What a request has to show.

    Attributes
    ----------
    token : str
        What presses the stop; empty for a page that only shows.
    hosts : tuple of str
        Names, beside ``localhost`` and addresses, under which the page may be asked for.
    """

    token: str = ''
    hosts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.token and not SHORTEST_TOKEN <= len(self.token) <= _LONGEST_TOKEN:
            fault = f'expected a token of {SHORTEST_TOKEN} to {_LONGEST_TOKEN} characters'
            raise LiveError(f'{fault}, got {len(self.token)}')
        if not (self.token.isascii() and all(sign.isprintable() for sign in self.token)):
            raise LiveError('expected a token of printable ASCII, got other characters')

    def knows_host(self, host: str) -> bool:
        """Return whether a ``Host`` may be answered.

        An address is what it says it is; a name could have been made to point here.
        """
        try:
            parts = urlsplit(f'//{host}')
            name, _ = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or parts.netloc != host or '@' in host or parts.path:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name == 'localhost' or name in {known.lower() for known in self.hosts}
        return True

    @staticmethod
    def same_origin(origin: str | None, host: str) -> bool:
        """Return whether a request comes from the page itself, or from no page at all."""
        if origin is None:
            return True
        try:
            place = urlsplit(origin)
        except ValueError:
            return False
        return place.scheme in ('http', 'https') and place.netloc.lower() == host.lower()

    def may_stop(self, authorization: str | None) -> bool:
        """Return whether an ``Authorization`` holds the token; takes as long for any wrong one."""
        if not self.token or authorization is None or not authorization.startswith(_SCHEME):
            return False
        given = authorization.removeprefix(_SCHEME).encode('utf-8', 'surrogateescape')
        return hmac.compare_digest(given, self.token.encode())


def token_of(path: Path) -> str:
    """Return the token in a file that only its owner can read.

    Raises
    ------
    LiveError
        If it cannot be read, others can read it, or there is no token in it.
    """
    try:
        with path.open('rb') as file:
            mode = stat.S_IMODE(path.stat().st_mode)
            content = file.read(_LONGEST_TOKEN + 2)
    except OSError as error:
        raise LiveError(f'expected a file with a token, got {path}: {error}') from error
    if mode & 0o077:
        raise LiveError(f'expected {path} to be readable by its owner only, got mode {mode:o}')
    token = content.decode('utf-8', 'replace').strip()
    if not token:
        raise LiveError(f'expected a token in {path}, got an empty file')
    return token


RATE = 10.0
"""Frames a second at most; between them the browser moves the course on by itself."""

MOST_BROWSERS = 32
MOST_CONNECTIONS = 128
# One that says more between two frames does not draw them.
_MOST_MESSAGES = 20
_LONGEST_BODY = 1024
_PATIENCE = 10.0

_HERE = files('rpms_ros.live')
_UPLOT = _HERE / 'uplot'
FILES = {
    '/': (_HERE / 'page.html', 'text/html'),
    '/page.css': (_HERE / 'page.css', 'text/css'),
    '/page.js': (_HERE / 'page.js', 'text/javascript'),
    '/plots.js': (_HERE / 'plots.js', 'text/javascript'),
    '/uPlot.css': (_UPLOT / 'uPlot.min.css', 'text/css'),
    '/uPlot.js': (_UPLOT / 'uPlot.iife.min.js', 'text/javascript'),
}
"""What is served, by its path: the file and its type."""


class Stop(Protocol):
    """What the page's stop presses; called by the thread of the server."""

    def press(self) -> None:
        """Stop the driver, and hold the stop."""

    def let_go(self) -> None:
        """Hold it no more; the driver stays stopped until somebody resets it."""


class LiveServer:
    """Serves the page of a session.

    Parameters
    ----------
    session : LiveSession
        What is shown; belongs to the thread of the server once that runs.
    listen : callable
        Takes what has come since the last call, given the time of a steady clock [s].
    access : Access
        Who may look and who may stop.
    stop : Stop, optional
        What the stop presses; none for a page that only shows.
    address : str
        Of this machine, where the server listens.
    port : int
        Where the server listens; 0 takes a free one.

    Raises
    ------
    LiveError
        If the port is taken, or the address is not one of this machine.
    """

    def __init__(
        self,
        session: LiveSession,
        listen: Callable[[float], None],
        access: Access,
        stop: Stop | None = None,
        address: str = '127.0.0.1',
        port: int = 0,
    ) -> None:
        try:
            self._socket = _bound(address, port)
        except (OSError, UnicodeError, OverflowError) as error:
            fault = f'expected to listen on port {port} of {address}, got {error}'
            raise LiveError(fault) from error
        self.address = address
        self.port: int = self._socket.getsockname()[1]
        self.failure: Exception | None = None
        self.browsers: set[_Stream] = set()
        self.contents = {path: (file.read_bytes(), kind) for path, (file, kind) in FILES.items()}
        self.session, self.access, self.stop = session, access, stop
        self._listen = listen
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='live_page', daemon=True)

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the page."""
        usual = f'[{self.address}]' if ':' in self.address else self.address
        here = {'': 'localhost', '0.0.0.0': '127.0.0.1', '::': '[::1]'}
        return f'http://{here.get(self.address, usual)}:{self.port}/'

    def start(self) -> None:
        """Listen from now on."""
        self._thread.start()

    def close(self) -> None:
        """End the thread, its connections and the port."""
        self._closing.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._socket.close()

    def call(self, function: Callable[[], None]) -> None:
        """Have the thread of the server call a function soon; any thread may ask."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(function)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # noqa: BLE001  the node that owns this thread says so and ends
            self.failure = error

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = _Server(
            _application(self),
            max_body_size=_LONGEST_BODY,
            max_header_size=16 * _LONGEST_BODY,
            idle_connection_timeout=_PATIENCE,
            body_timeout=_PATIENCE,
        )
        server.add_socket(self._socket)
        due = time.monotonic()
        try:
            while not self._closing.is_set():
                self._tick()
                due += 1.0 / RATE
                await asyncio.sleep(max(due - time.monotonic(), 0.0))
                # a step that was missed is not made up for
                due = max(due, time.monotonic())
        finally:
            server.stop()
            for browser in list(self.browsers):
                browser.close(1001, 'the page has ended')
            await asyncio.wait_for(server.close_all_connections(), _PATIENCE)

    def _tick(self) -> None:
        now = time.monotonic()
        self._listen(now)
        self.session.advance(now)
        # browsers that keep up have the same cursor
        made: dict[Cursor, tuple[Cursor, str | None]] = {}
        for browser in [one for one in self.browsers if one.ready]:
            if browser.cursor not in made:
                cursor, frame = self.session.frame(browser.cursor)
                made[browser.cursor] = (cursor, None if frame is None else _encoded(frame))
            cursor, text = made[browser.cursor]
            if text is not None:
                browser.send(cursor, text)


def _bound(address: str, port: int) -> socket.socket:
    """Return a socket that listens; nobody else can listen there."""
    family, _, _, _, place = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
    bound = socket.create_server(place[:2], family=family, backlog=MOST_CONNECTIONS)
    bound.setblocking(False)
    return bound


_encoded = json.JSONEncoder(allow_nan=False, separators=(',', ':')).encode


class _Server(HTTPServer):
    """Turns connections away beyond a bound, before anything is read from them."""

    def handle_stream(self, stream: IOStream, address: tuple[object, ...]) -> None:
        if len(self._connections) >= MOST_CONNECTIONS:
            stream.close()
            return
        stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 18)
        super().handle_stream(stream, address)


def _application(server: LiveServer) -> Application:
    return Application(
        [
            (r'/stream', _Stream, {'server': server}),
            (r'/(stop|let_go)', _StopHandler, {'server': server}),
            (r'(/.*)', _Files, {'server': server}),
        ],
        # whoever asks often would fill a disk
        log_function=lambda _: None,
        # a browser answers each frame with one letter
        websocket_max_message_size=64,
        websocket_ping_interval=_PATIENCE,
        websocket_ping_timeout=_PATIENCE,
    )


class _Guarded(RequestHandler):
    """Answers only who asks by a known name and from the page itself."""

    def initialize(self, server: LiveServer) -> None:
        self.server = server

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)
        self.clear_header('Server')

    def prepare(self) -> None:
        host = self.request.headers.get('Host', '')
        if not self.server.access.knows_host(host):
            self.refuse(421, 'expected an address or a name that was allowed with --allow-name')
        elif not self.server.access.same_origin(self.request.headers.get('Origin'), host):
            self.refuse(403, 'expected a request of the page itself')

    def refuse(self, status: int, reason: str) -> None:
        """Answer with a status and a line."""
        self.set_status(status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{reason}\n')

    def write_error(self, status_code: int, **_: object) -> None:
        self.refuse(status_code, self._reason)


class _Files(_Guarded):
    """The page and what it needs."""

    def get(self, path: str) -> None:
        if path not in self.server.contents:
            self.refuse(404, 'expected a part of the page')
            return
        content, kind = self.server.contents[path]
        self.set_header('Content-Type', f'{kind}; charset=utf-8')
        self.finish(content)


class _StopHandler(_Guarded):
    """Presses the stop for whoever has the token."""

    def post(self, what: str) -> None:
        stop = self.server.stop
        if stop is None:
            self.refuse(403, 'expected a page with a token, this one only shows')
        elif not self.server.access.may_stop(self.request.headers.get('Authorization')):
            self.refuse(403, 'expected the token of this page, got another one')
        else:
            (stop.press if what == 'stop' else stop.let_go)()
            self.finish({'done': what})


class _Stream(WebSocketHandler, _Guarded):
    """One browser: gets a frame, takes it, asks for the next."""

    def initialize(self, server: LiveServer) -> None:
        super().initialize(server)
        self.cursor = Cursor()
        self.ready = False
        self._messages = 0

    def prepare(self) -> None:
        super().prepare()
        if not self._finished and len(self.server.browsers) >= MOST_BROWSERS:
            self.refuse(503, f'expected at most {MOST_BROWSERS} browsers, there are as many')

    def check_origin(self, origin: str) -> bool:
        return self.server.access.same_origin(origin, self.request.headers.get('Host', ''))

    def open(self) -> None:
        self.server.browsers.add(self)
        self.ready = True

    def on_message(self, _message: str | bytes) -> None:
        self.ready = True
        self._messages += 1
        if self._messages > _MOST_MESSAGES:
            self.close(1008, 'expected one message a frame')

    def on_close(self) -> None:
        self.server.browsers.discard(self)

    def send(self, cursor: Cursor, text: str) -> None:
        """Send a frame, after which the browser has what `cursor` says."""
        self.cursor, self.ready, self._messages = cursor, False, 0
        try:
            # asyncio complains of a browser that has gone unless somebody looks
            sent = self.write_message(text)
            sent.add_done_callback(lambda done: done.cancelled() or done.exception())
        except WebSocketClosedError:
            self.server.browsers.discard(self)
