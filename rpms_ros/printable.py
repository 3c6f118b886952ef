# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Text from anybody, on one line of a terminal or in a cell of a table; numbers in words."""

import math

_FORMULA_STARTS = ('=', '+', '-', '@', '\t', '\r')
_MOST_DECIMALS = 3


def printable(text: str) -> str:
    """Return text in which nothing moves the cursor or breaks the line of a terminal."""
    return ''.join(
        char if char.isprintable() else char.encode('unicode_escape', 'replace').decode()
        for char in text
    )


def counted(count: int, one: str, several: str | None = None) -> str:
    """Return a number with its noun, in the plural where there is not exactly one.

    >>> counted(1, 'pulse'), counted(0, 'pulse'), counted(2, 'intensity', 'intensities')
    ('1 pulse', '0 pulses', '2 intensities')
    """
    return f'{count} {one if count == 1 else several or one + "s"}'


def told_apart(one: float, other: float, digits: int = 3) -> tuple[str, str]:
    """Return two numbers with `digits`, or with as many as it takes to tell them apart.

    >>> told_apart(40.0, 41.26), told_apart(40.0, 40.004)
    (('40', '41.3'), ('40', '40.004'))
    """
    shown = f'{one:.{digits}g}', f'{other:.{digits}g}'
    # 17 digits tell any two numbers apart
    return shown if shown[0] != shown[1] or digits == 17 else told_apart(one, other, digits + 1)


def spreadsheet_text(text: str) -> str:
    """Return text that no spreadsheet takes for a formula: such a one gets an apostrophe."""
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text


def percent_explained(share: float) -> str:
    """Return a share as per cent, with the decimals that distinguish it from 100 %.

    >>> [percent_explained(share) for share in (0.853, 0.9987, 0.99998, 1.0)]
    ['85.3', '99.9', '99.998', 'more than 99.999']
    """
    missing = 100.0 * (1.0 - share)
    if missing < 10.0**-_MOST_DECIMALS:
        return 'more than 99.' + _MOST_DECIMALS * '9'
    return f'{100.0 * share:.{max(1, math.ceil(-math.log10(missing)))}f}'
