# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is exported: pulses, force and estimates, with one time for all of them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, ForceTrace, IntArray, PulseTrain

FORMAT = 'rpms_ros session'
"""By this name an export is known when it is read again."""
VERSION = 1
TIME, INTENSITY, WIDTH, SEQUENCE = 'time_s', 'intensity', 'width_s', 'sequence'
FORCE_COLUMNS = {'N': 'force_N', 'N m': 'torque_Nm'}
"""Name of the column of the force, by its unit."""
# MATLAB takes no longer name of a field.
_LONGEST_NAME = 60


@dataclass(frozen=True)
class EstimateTable:
    """Estimates of an identifier, one row each.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (estimates,)
        Newest force sample of each [ns].
    numbers : mapping of str to ndarray, shape (estimates,)
        Columns; not a number where an estimate has none.
    texts : mapping of str to sequence of str
        Columns.
    """

    stamp_ns: IntArray
    numbers: Mapping[str, FloatArray]
    texts: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class SessionExport:
    """A session to be exported.

    Attributes
    ----------
    name : str
        What people call it.
    pulses, forces : PulseTrain, ForceTrace
        In the order in which they were received.
    unit : str
        Of the force: ``N``, or ``N m`` for a torque.
    estimates : EstimateTable or None
        None if none were recorded.
    session_hash : str
        Of what was read.
    notes : mapping of str to str
        What the recorder noted for people.
    anonymous : bool
        Whether date, name and notes are left out; times begin at 0 then.
    """

    name: str
    pulses: PulseTrain
    forces: ForceTrace
    unit: str = 'N'
    estimates: EstimateTable | None = None
    session_hash: str = ''
    notes: Mapping[str, str] = field(default_factory=dict)
    anonymous: bool = False

    @property
    def origin_ns(self) -> int:
        """Stamp of the first force sample, from which times are counted [ns]."""
        for stamps in (self.forces.stamp_ns, self.pulses.onset_ns):
            if len(stamps):
                return int(stamps.min())
        return 0

    @property
    def stated_origin_ns(self) -> int:
        """What the export says of the origin; if it is anonymous, times begin at 0 [ns]."""
        if not self.anonymous:
            return self.origin_ns
        first = min(int(self.pulses.onset_ns.min(initial=self.origin_ns)), self.origin_ns)
        return self.origin_ns - first

    def facts(self) -> dict[str, object]:
        """Return what is written beside the tables."""
        facts: dict[str, object] = {
            'format': FORMAT,
            'version': VERSION,
            'origin_ns': str(self.stated_origin_ns),
            'unit': self.unit,
        }
        if self.anonymous:
            return facts
        return {
            **facts,
            'name': self.name,
            'session_hash': self.session_hash,
            'notes': dict(self.notes),
        }


def seconds_text(stamp_ns: IntArray, origin_ns: int) -> list[str]:
    """Return times after the origin in seconds with all of their nanoseconds."""
    texts = []
    for stamp in stamp_ns.tolist():
        whole, rest = divmod(abs(stamp - origin_ns), NANOSECONDS_PER_SECOND)
        texts.append(f'{"-" if stamp < origin_ns else ""}{whole}.{rest:09d}')
    return texts


def seconds(stamp_ns: IntArray, origin_ns: int) -> FloatArray:
    """Return times after the origin [s]."""
    return (stamp_ns - origin_ns).astype(np.float64) / NANOSECONDS_PER_SECOND


def column_names(names: Iterable[str]) -> list[str]:
    """Return names that any program takes: letters, digits and underscores, no two the same.

    The names of parameters come from a recording, that is from anybody.
    """
    taken: list[str] = []
    for name in names:
        plain = re.sub(r'[^A-Za-z0-9_]', '_', name)[:_LONGEST_NAME]
        plain = plain if plain[:1].isalpha() else f'x{plain}'
        count = 2
        unlike = plain
        while unlike in taken:
            unlike = f'{plain[: _LONGEST_NAME - 5]}_{count}'
            count += 1
        taken.append(unlike)
    return taken
