# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Who may look and stop; the server against other pages, floods, giants, the slow, the many."""

import asyncio
import contextlib
import hashlib
import json
import socket
import struct
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest
from tornado.httpclient import HTTPRequest
from tornado.iostream import StreamClosedError
from tornado.websocket import WebSocketClosedError, websocket_connect

from rpms_ros.errors import LiveError
from rpms_ros.live.live_session import Cursor
from rpms_ros.live.server import FILES, Access, LiveServer, token_of

TOKEN = 'correct-horse-battery'
MILLISECOND = 1_000_000


class Feed:
    """A sensor at 1 kHz, as the server's thread hears it, and what the stop was told."""

    def __init__(self, session, start_ns):
        self.session, self.start_ns = session, start_ns
        self.samples, self.begun, self.told = 0, None, []

    def listen(self, now):
        self.begun = self.begun or now
        due = int(1000 * (now - self.begun))
        stamp_ns = self.start_ns + np.arange(self.samples, due) * MILLISECOND
        self.session.force(stamp_ns, np.ones(len(stamp_ns)))
        self.samples = due

    def press(self):
        self.told.append('press')

    def let_go(self):
        self.told.append('let_go')


@pytest.fixture
def feed(session, start_ns):
    return Feed(session, start_ns)


@contextlib.contextmanager
def served(session, listen, *access_and_stop):
    running = LiveServer(session, listen, *access_and_stop)
    running.start()
    try:
        yield running
    finally:
        running.close()


@pytest.fixture
def server(session, feed):
    with served(session, feed.listen, Access(TOKEN), feed) as running:
        yield running
    assert running.failure is None


def asked(server, path='/', method='GET', **headers):
    """Status and text of an answer."""
    request = urllib.request.Request(server.url.rstrip('/') + path, method=method)
    for name, value in headers.items():
        request.add_header(name.replace('_', '-'), value)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


@pytest.mark.parametrize('path', FILES)
def test_every_part_of_the_page_is_served_with_the_headers(server, path):
    status, text, headers = asked(server, path)
    assert (status, bool(text)) == (200, True)
    assert headers['Content-Security-Policy'].startswith("default-src 'none'")
    assert headers['X-Content-Type-Options'] == 'nosniff'
    assert headers['Server'] is None


@pytest.mark.parametrize('path', ['/nothing', '/../errors.py', '/page.css/', '/%2e%2e/errors.py'])
def test_nothing_else_is_served(server, path):
    assert asked(server, path)[0] == 404


@pytest.mark.parametrize('path', ['/', '/stream', '/stop'])
def test_a_name_that_was_made_to_point_here_is_refused(server, path):
    method = 'POST' if path == '/stop' else 'GET'
    status, text, _ = asked(server, path, method, Host='evil.example')
    assert status == 421
    assert text == 'expected an address or a name that was allowed with --allow-name\n'


def test_the_stop_needs_the_token(server, feed):
    def post(path='/stop', **headers):
        return asked(server, path, 'POST', **headers)[:2]

    refused = (403, 'expected the token of this page, got another one\n')
    assert post() == refused
    assert post(Authorization='Bearer wrong-horse-battery') == refused
    assert post(Authorization=f'Bearer {TOKEN}', Origin='http://evil.example')[0] == 403
    assert asked(server, '/stop', Authorization=f'Bearer {TOKEN}')[0] == 405
    assert asked(server, f'/stop?token={TOKEN}', 'POST')[0] == 403
    assert feed.told == []
    origin = server.url.rstrip('/')
    assert post(Authorization=f'Bearer {TOKEN}', Origin=origin) == (200, '{"done": "stop"}')
    assert post('/let_go', Authorization=f'Bearer {TOKEN}')[0] == 200
    assert feed.told == ['press', 'let_go']


def test_a_page_without_a_token_has_no_stop(session, feed):
    with served(session, feed.listen, Access()) as running:
        for header in ({}, {'Authorization': 'Bearer '}, {'Authorization': f'Bearer {TOKEN}'}):
            status, text, _ = asked(running, '/stop', 'POST', **header)
            assert (status, text) == (403, 'expected a page with a token, this one only shows\n')
    assert feed.told == []


def test_only_the_own_address_of_this_machine_is_listened_on(server):
    assert server.address == '127.0.0.1'
    # another of its addresses, which needs no network either
    with pytest.raises(ConnectionRefusedError, match='refused'):
        socket.create_connection(('127.0.0.2', server.port), timeout=60)


def test_an_error_of_the_listener_ends_the_server_and_is_kept(session, wait_for):
    def listen(_now):
        raise LiveError('expected to hear, got nothing')

    with served(session, listen, Access()) as running:
        wait_for(lambda: running.failure is not None)
    assert str(running.failure) == 'expected to hear, got nothing'


def stream_address(server):
    return server.url.replace('http', 'ws') + 'stream'


async def frames(server, count, answer='n'):
    """The first frames of a browser that draws at once."""
    socket = await websocket_connect(stream_address(server))
    found = []
    while len(found) < count:
        text = await asyncio.wait_for(socket.read_message(), 60)
        if text is None:
            socket.close()
            return found
        found.append(json.loads(text))
        await socket.write_message(answer)
    await ended(socket)
    return found


async def ended(socket):
    """Close a connection from this side, to its end."""
    socket.close()
    while await asyncio.wait_for(socket.read_message(), 60) is not None:
        pass


def test_a_browser_gets_the_course_and_then_what_is_new(server, feed, wait_for):
    wait_for(lambda: feed.samples > 500)
    found = asyncio.run(frames(server, 10))
    assert found[0]['session'] == {'can_stop': False, 'unit': 'N'}
    parts = [frame['force'] for frame in found if 'force' in frame]
    assert len(parts[0]['low']) > 50
    # each begins where the one before ended: how long it is, is up to the machine
    ends = [part['first'] + len(part['low']) for part in parts]
    assert [part['first'] for part in parts[1:]] == ends[:-1]


def test_another_page_gets_no_stream(server):
    async def connect(origin):
        request = HTTPRequest(stream_address(server), headers={'Origin': origin})
        await websocket_connect(request)

    for origin in ('http://evil.example', 'null'):
        with pytest.raises(Exception, match='403'):
            asyncio.run(connect(origin))


def test_giant_messages_and_floods_end_the_connection(server):
    giant = asyncio.run(frames(server, 10, 'x' * 100_000))
    assert len(giant) < 10

    async def flood():
        socket = await websocket_connect(stream_address(server))
        sent = 0
        with contextlib.suppress(WebSocketClosedError, StreamClosedError):
            for _ in range(100_000):
                await socket.write_message('n')
                sent += 1
        await ended(socket)
        return sent

    assert asyncio.run(flood()) < 100_000
    assert asked(server)[0] == 200


def handshake(server):
    """A raw connection to the stream, whose frames nobody reads."""
    raw = socket.create_connection(('127.0.0.1', server.port), timeout=60)
    raw.sendall(
        b'GET /stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
        b'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n'
    )
    assert b' 101 ' in raw.recv(64)
    return raw


def test_a_frame_that_claims_to_be_huge_is_not_waited_for(server, wait_for):
    raw = handshake(server)
    wait_for(lambda: len(server.browsers) == 1)
    # masked text of 2^40 bytes, of which nothing comes
    raw.sendall(b'\x81\xff' + struct.pack('>Q', 2**40) + b'\0\0\0\0')
    wait_for(lambda: not server.browsers)
    raw.close()


def test_one_that_never_reads_gets_one_frame_and_holds_up_nobody(server, wait_for):
    slow = handshake(server)
    wait_for(lambda: len(server.browsers) == 1)
    (stalled,) = server.browsers
    # it has its first frame
    wait_for(lambda: stalled.cursor != Cursor() and not stalled.ready)
    before = stalled.cursor
    assert len(asyncio.run(frames(server, 20))) == 20
    assert stalled.cursor == before
    slow.close()
    wait_for(lambda: not server.browsers)


@pytest.mark.parametrize(
    'request_bytes',
    [
        b'\x00\xff' * 100 + b'\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ' + b'x' * 100_000 + b'\r\n\r\n',
        b'POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999\r\n\r\n',
        b'POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n',
        b'GET / HTTP/1.1\r\n\r\n',
        b'GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n',
    ],
)
def test_requests_that_are_none_end_and_harm_nobody(server, feed, request_bytes):
    with socket.create_connection(('127.0.0.1', server.port), timeout=60) as raw:
        try:
            raw.sendall(request_bytes)
            answer = raw.recv(100)
        except ConnectionError:
            answer = b''
    assert b' 200 ' not in answer
    assert asked(server)[0] == 200
    assert feed.told == []


def test_closing_ends_the_thread_and_frees_the_port(session, feed):
    with served(session, feed.listen, Access()) as running:
        raw = handshake(running)
    raw.close()
    assert 'live_page' not in {one.name for one in threading.enumerate()}
    again = LiveServer(session, feed.listen, Access(), port=running.port)
    again.close()


def test_the_plotting_library_is_the_published_one() -> None:
    found = {
        path: hashlib.sha256(FILES[path][0].read_bytes()).hexdigest()
        for path in ('/uPlot.js', '/uPlot.css')
    }
    # uPlot 1.6.32 on the npm registry
    assert found == {
        '/uPlot.js': '19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f',
        '/uPlot.css': 'df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04',
    }


def test_addresses_and_allowed_names_are_answered_and_no_name_that_could_be_made_to_point_here():
    own = ('127.0.0.1', '127.0.0.1:8765', 'localhost:1', '[::1]:8765', '192.168.0.7:80')
    access = Access(hosts=('lab-pc',))
    assert [one for one in (*own, 'LAB-PC:8765') if not access.knows_host(one)] == []
    names = ('', 'evil.example', 'evil.example:8765', 'localhost.evil.example', '0x7f.1', '::1')
    odd = ('a@127.0.0.1', '127.0.0.1/', '127.0.0.1:x', '[::1', '127.0.0.1 evil')
    others = (*names, '127.0.0.1.evil.example', *odd)
    assert [one for one in others if Access().knows_host(one)] == []


def test_a_request_of_another_page_is_told_from_the_page_s_own():
    own = '127.0.0.1:8765'
    assert Access.same_origin(None, own)
    assert Access.same_origin(f'http://{own}', own)
    foreign = ('http://evil.example', 'null', '', 'http://127.0.0.1:8766', 'file://', 'http://[')
    assert not any(Access.same_origin(one, own) for one in foreign)


def test_only_the_token_stops():
    token = 'correct horse battery'
    access = Access(token)
    assert access.may_stop(f'Bearer {token}')
    wrong = ('Bearer ', f'Bearer {token}x', token, f'Basic {token}', 'Bearer é\udcff')
    assert not any(access.may_stop(one) for one in (None, '', *wrong))
    # a page without a token cannot be stopped by an empty one
    assert not Access().may_stop('Bearer ')


@pytest.mark.parametrize('token', ['short', 'x' * 201])
def test_a_token_that_can_be_guessed_or_is_none_is_refused(token):
    with pytest.raises(LiveError, match='expected a token of 16 to 200 characters, got'):
        Access(token)


def test_a_token_file_is_of_its_owner_alone(tmp_path):
    path = tmp_path / 'token'
    path.write_text(f'{TOKEN}\n')
    path.chmod(0o644)
    with pytest.raises(LiveError, match='readable by its owner only, got mode 644'):
        token_of(path)
    path.chmod(0o600)
    assert token_of(path) == TOKEN
    path.write_text('\n')
    with pytest.raises(LiveError, match=r'expected a token in .*, got an empty file'):
        token_of(path)
    with pytest.raises(LiveError, match='expected a file with a token, got'):
        token_of(tmp_path)
