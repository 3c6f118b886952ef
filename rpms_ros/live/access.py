# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Who may look at the page, and who may press its stop.

Looking needs no token: the server is bound to this machine's own address unless somebody asks for
another.  A page of another site is kept out by the name that it has to use (``Host``, against
names that are made to point here) and by where it comes from (``Origin``).  Pressing needs the
token, in a header that no foreign page can send without being asked first.
"""

import hmac
import ipaddress
import secrets
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from rpms_ros.errors import LiveError

SHORTEST_TOKEN = 16
_LONGEST_TOKEN = 200
_SCHEME = 'Bearer '

HEADERS: Mapping[str, str] = {
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
"""Sent with every answer: nothing from elsewhere, in no frame, kept by nobody."""


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
            raise LiveError(
                f'expected a token of {SHORTEST_TOKEN} to {_LONGEST_TOKEN} characters, '
                f'got {len(self.token)}'
            )
        if not (self.token.isascii() and all(sign.isprintable() for sign in self.token)):
            raise LiveError('expected a token of printable ASCII, got other characters')

    def knows_host(self, host: str) -> bool:
        """Return whether a ``Host`` may be answered.

        An address is what it says it is; a name could have been made to point here.
        """
        name = _name_of(host)
        if name is None:
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


def _name_of(host: str) -> str | None:
    """Return the name or address in ``name:port``, None if it is neither."""
    try:
        parts = urlsplit(f'//{host}')
        _ = parts.port
    except ValueError:
        return None
    whole = parts.netloc == host and '@' not in host and not parts.path
    return parts.hostname if whole else None


def new_token() -> str:
    """Return a token that nobody guesses."""
    return secrets.token_urlsafe(24)


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
