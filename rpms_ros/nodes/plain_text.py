# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Text from outside in the form in which a message can carry it."""

LONGEST = 2000


def plain_text(text: object) -> str:
    """Return text that can be encoded, without control characters, of bounded length."""
    said = str(text)[:LONGEST].encode('utf-8', 'replace').decode()
    return ''.join(sign if sign.isprintable() else ' ' for sign in said)
