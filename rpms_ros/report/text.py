# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results as text: tables that fit a terminal, numbers with unit and interval."""

import math
import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import NormalDist

from rpms_ros.errors import ReportError
from rpms_ros.printable import printable

# Columns of a line, if the terminal has them.
_WIDEST = 100
# Before a word that does not fit beside its label, and before what continues a note.
_CLOSE = '    '
# Of the upper end of an interval.
_NEAR = 0.1
# Narrower and larger numbers are shown with four digits.
_MOST_PLACES = 9
_LARGE = 1e6


def write_text(path: Path, text: str) -> None:
    """Write a file, and the folders that it is in.

    Raises
    ------
    ReportError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ReportError(f'expected to write {path}, got {error}') from error


def labelled(rows: Iterable[tuple[str, str]]) -> str:
    """Return a line for each label and text; a long text continues below its beginning."""
    rows = list(rows)
    column = max((len(label) for label, _ in rows), default=0)
    return '\n'.join(_wrapped(f'  {label:<{column}}  ', text) for label, text in rows)


def with_interval(
    found: Mapping[str, float | None], factor: float = 1.0, unit: str = '', after: str = ''
) -> str:
    """Return a value with its interval, all with as many decimals as the interval's width.

    Two digits of half the width are shown.  What is near its bound of 0 is *at most* something.

    Parameters
    ----------
    found : mapping
        ``value``, ``lower`` and ``upper``; without ends that are known the value is alone.
    factor : float
        Factor before rounding, as 1000 for milliseconds.
    unit, after : str
        Text behind the value, and behind all.
    """
    value, lower, upper = (
        float('nan') if found.get(name) is None else factor * float(found[name] or 0.0)
        for name in ('value', 'lower', 'upper')
    )
    half = 0.5 * (upper - lower)
    if not (math.isfinite(half) and math.isfinite(value)):
        return f'{value:.4g}{unit}{after}'
    if lower == 0.0 and value <= _NEAR * upper:
        # two digits, and never a power of ten beside the unit
        return f'at most {upper:{".0f" if 99.0 < upper < _LARGE else ".2g"}}{unit}{after}'
    places = 1 - math.floor(math.log10(half)) if half > 0.0 else _MOST_PLACES
    if places >= _MOST_PLACES or abs(value) >= _LARGE:
        return f'{value:.4g}{unit} ({lower:.4g} to {upper:.4g}){after}'
    shown = [f'{one:.{max(0, places)}f}' for one in (value, lower, upper)]
    return f'{shown[0]}{unit} ({shown[1]} to {shown[2]}){after}'


def noted(rows: Iterable[tuple[str, str]]) -> str:
    """Return ``name: text`` for each, a long text indented on the lines that follow."""
    return '\n'.join(_wrapped(f'  {label}: ', text, _CLOSE) for label, text in rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1) -> str:
    """Return a table; the first `texts` columns are aligned left, the numbers after them right."""
    lines = [list(head), *([printable(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    sides = '<' * texts + '>' * (len(head) - texts)
    shape = '  '.join(f'{{:{side}{size}}}' for side, size in zip(sides, widths, strict=True))
    return '\n'.join(shape.format(*line).rstrip() for line in lines)


def _wrapped(start: str, text: str, later: str | None = None) -> str:
    text = ''.join(letter if letter.isprintable() or letter.isspace() else '?' for letter in text)
    columns = min(_WIDEST, shutil.get_terminal_size((_WIDEST, 24)).columns)
    room, above = max(columns, len(start) + 20), ''
    later = ' ' * len(start) if later is None else later
    # hashes and other text to be copied are not split
    if len(later) + max(map(len, text.split()), default=0) > room:
        above, start, later = f'{start.rstrip()}\n', _CLOSE, _CLOSE
    shape = textwrap.TextWrapper(
        room, initial_indent=start, subsequent_indent=later, break_on_hyphens=False
    )
    return above + (shape.fill(text) or start.rstrip())


# A wider interval is everything.
_MOST_LOGARITHM = 50.0
_WORDS = {
    'u_thr': 'threshold u_thr',
    'u_sat': 'saturation u_sat',
    'alpha_thr': 'sharpness alpha_thr',
    'alpha_sat': 'sharpness alpha_sat',
    'twitch_time_constant_s': 'time constant T_a',
    'latency_s': 'delay of the model',
    'order': 'order of the twitch',
    'twitch_peak_n': 'peak of the twitch',
}
RATE_WORDS = {
    'force_percent': 'steady force, % a minute',
    'time_constant_percent': 'T_a of the twitch, % a minute',
    'u_thr': 'threshold, share of the maximum a minute',
    'u_sat': 'saturation, share of the maximum a minute',
}
"""Rates of change, by name."""


def label(name: str) -> str:
    """Return what a parameter is; its name if that is not known."""
    return _WORDS.get(name, name)


def interval_of(
    name: str, value: float, deviation: float | None, confidence: float | None
) -> tuple[float, float] | None:
    """Return the ends of the interval of a parameter of the recruitment curve, if there is one.

    Those of the sharpness alpha are symmetric in their logarithm, in which they are estimated.

    Parameters
    ----------
    name : str
        Of the parameter.
    value, deviation : float
        Estimate and its standard deviation, None or NaN if that is not known.
    confidence : float
        Level of the interval, None if the estimator states none.
    """
    if deviation is None or not confidence or not math.isfinite(deviation):
        return None
    width = NormalDist().inv_cdf(0.5 + 0.5 * confidence) * deviation
    if not (name.startswith('alpha') and value > 0):
        return value - width, value + width
    factor = math.exp(min(width / value, _MOST_LOGARITHM))
    return value / factor, value * factor


def recruitment_shown(
    name: str,
    value: float | None,
    deviation: float | None = None,
    confidence: float | None = None,
    flag: str | None = None,
) -> str:
    """Return a parameter of the recruitment curve with its interval, and how well it is known.

    Parameters
    ----------
    name, value, deviation, confidence
        As in `interval_of`.
    flag : str
        One of `rpms_ros.report.result.IDENTIFIABILITY`.
    """
    if value is None or not math.isfinite(value):
        return 'the data do not determine it'
    lower, upper = interval_of(name, value, deviation, confidence) or (None, None)
    text = shown(name, {'value': value, 'lower': lower, 'upper': upper}, '')
    return f'{text}, known roughly' if flag == 'informed' else text


def shown(name: str, found: Mapping[str, float | None], unit: str) -> str:
    """Return a parameter in its unit, with its interval.

    Parameters
    ----------
    name : str
        Of the parameter.
    found : mapping
        ``value``, ``lower``, ``upper``, in the unit of the name.
    unit : str
        Of every force: N or N m.
    """
    if name.startswith('u_'):
        return with_interval(found, after=' of the maximum')
    if name.endswith('_s'):
        return with_interval(found, 1e3, ' ms')
    return with_interval(found, unit=f' {unit}' if name.endswith('_n') else '')
