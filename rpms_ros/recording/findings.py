# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found wrong with a recording while reading what can be read."""

from collections import Counter
from dataclasses import dataclass
from dataclasses import field

from rpms_ros.printable import printable

# A file of damaged chunks must not become a screen full of lines, nor a memory full of them.
_MOST_REMARKS = 10


@dataclass
class Findings:
    """Faults by kind, and one line for people on each.

    Attributes
    ----------
    counts : Counter of str
        How often each kind of fault was met, such as ``truncated_file``.
    """

    counts: Counter[str] = field(default_factory=Counter)
    _remarks: dict[str, list[str]] = field(default_factory=dict)
    _left_out: Counter[str] = field(default_factory=Counter)

    def add(self, kind: str, remark: str, count: int = 1) -> None:
        """Count a fault and note it in words."""
        self.counts[kind] += count
        remarks = self._remarks.setdefault(kind, [])
        if len(remarks) < _MOST_REMARKS:
            remarks.append(printable(remark))
        else:
            self._left_out[kind] += 1

    @property
    def remarks(self) -> list[str]:
        """Lines that name what is missing or odd, a few of each kind."""
        lines: list[str] = []
        for kind, remarks in self._remarks.items():
            lines += remarks
            if more := self._left_out[kind]:
                lines.append(f'{more} more of {kind}')
        return lines
