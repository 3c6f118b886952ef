# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Text from anybody, on one line of a terminal or in a cell of a table."""

_FORMULA_STARTS = ('=', '+', '-', '@', '\t', '\r')


def printable(text: str) -> str:
    """Return text in which nothing moves the cursor or breaks the line of a terminal."""
    return ''.join(
        char if char.isprintable() else char.encode('unicode_escape', 'replace').decode()
        for char in text
    )


def spreadsheet_text(text: str) -> str:
    """Return text that no spreadsheet takes for a formula: such a one gets an apostrophe."""
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text
