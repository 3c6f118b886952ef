# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Makes text from outside safe for a message: encodable, printable and short."""

LONGEST = 2000


def plain_text(text: object) -> str:
    """Return at most `LONGEST` characters, all of them printable and encodable as UTF-8."""
    said = str(text)[:LONGEST].encode('utf-8', 'replace').decode()
    return ''.join(sign if sign.isprintable() else ' ' for sign in said)
