"""What was found wrong with a recording while reading what can be read."""

from collections import Counter
from dataclasses import dataclass
from dataclasses import field


@dataclass
class Findings:
    """Faults by kind, and one line for people on each.

    Attributes
    ----------
    counts : Counter of str
        How often each kind of fault was met, such as ``truncated_file``.
    remarks : list of str
        Lines that name what is missing or odd.
    """

    counts: Counter[str] = field(default_factory=Counter)
    remarks: list[str] = field(default_factory=list)

    def add(self, kind: str, remark: str, count: int = 1) -> None:
        """Count a fault and note it in words."""
        self.counts[kind] += count
        self.remarks.append(remark)
