"""Pulses stamped long before the force: late, or the first ones after a clock has jumped back."""

from collections import deque

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import PulseTrain

# So long the force may go on before a stray pulse counts as late [ns].
_PATIENCE_NS = NANOSECONDS_PER_SECOND
_MOST = 1000


class StrayPulses(Restorable):
    """Keeps stray pulses until the force shows what they are.

    Parameters
    ----------
    overtaking_ns : int
        How much earlier than the force a pulse of a new time line may come [ns].
    """

    _kept: deque[tuple[int, PulseTrain]]
    _count: int
    _given_up: int

    def __init__(self, overtaking_ns: int) -> None:
        self._overtaking_ns = overtaking_ns
        self._kept = deque()
        self._count = 0
        self._given_up = 0

    def add(self, pulses: PulseTrain, newest_ns: int) -> None:
        """Keep pulses (maybe none) that came when the newest force was at `newest_ns`."""
        if not len(pulses):
            return
        kept = pulses[: max(_MOST - self._count, 0)]
        self._given_up += len(pulses) - len(kept)
        if len(kept):
            self._kept.append((newest_ns, kept))
            self._count += len(kept)

    def taken(self, newest_ns: int) -> PulseTrain:
        """Return the pulses that came just before the clock jumped; the others count as late."""
        kept, self._kept, self._count = self._kept, deque(), 0
        recent_ns = newest_ns - self._overtaking_ns
        self._given_up += sum(len(train) for since, train in kept if since < recent_ns)
        return PulseTrain.joined(
            [PulseTrain.of([]), *(train for since, train in kept if since >= recent_ns)]
        )

    def given_up(self, until_ns: int | None) -> int:
        """Return how many turned out to be late when the force has come to `until_ns`.

        None: it ends here.
        """
        while self._kept and (until_ns is None or self._kept[0][0] + _PATIENCE_NS <= until_ns):
            train = self._kept.popleft()[1]
            self._count -= len(train)
            self._given_up += len(train)
        count, self._given_up = self._given_up, 0
        return count
