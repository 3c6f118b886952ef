# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When the basis is compared with others, by stamps alone."""

from enum import Enum

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Since a response shows; later with this period [s].
_CHOICES_S = (1.0, 3.0, 7.0, 16.0, 32.0)
_PERIOD_S = 32.0
# Where all seems well it is compared with its neighbours only, but so often with all that people
# have.  Where residuals are alike it is compared sooner.
_GRIDS = 4
_AGAIN_NS = 3 * NANOSECONDS_PER_SECOND
# After the first pulse, if no response shows.
_UNSEEN_NS = 2 * NANOSECONDS_PER_SECOND
_NEVER_NS = -(2**62)


class Search(Enum):
    """With which bases the present one is compared."""

    NEIGHBOURS = 'its neighbours'
    EVERYWHERE = 'all that people have'


class BasisSchedule(Restorable):
    """Says when the basis is to be compared with others, and with which.

    Attributes
    ----------
    begun_ns : int or None
        Since when a response shows, or has to be looked at anew [ns].
    """

    begun_ns: int | None
    _stimulated_ns: int | None
    _choices: int
    _compared_ns: int

    def __init__(self) -> None:
        self._choices = 0
        self.forget()

    @property
    def begun(self) -> bool:
        """Whether a response shows."""
        return self.begun_ns is not None

    def begin(self, now_ns: int) -> None:
        """Take note of a response that shows from now on [ns]."""
        self.begun_ns, self._choices = now_ns, 0

    def forget(self) -> None:
        """Forget response and stimulation, but not how often bases were compared."""
        self.begun_ns = self._stimulated_ns = None
        self._compared_ns = _NEVER_NS

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Take note of pulses (pulses,) [ns, 1]: of the first that stimulates."""
        if self._stimulated_ns is None and intensity.any():
            self._stimulated_ns = int(onset_ns[(intensity > 0.0).argmax()])

    def due(self, now_ns: int, alike: bool) -> Search | None:
        """Return with which bases to compare now, None if not to.

        Parameters
        ----------
        now_ns : int
            Newest stamp [ns].
        alike : bool
            Whether neighbouring residuals are alike.
        """
        since_ns = self.begun_ns
        if since_ns is None and self._stimulated_ns is not None:
            # with a basis that does not fit a response may not show
            since_ns = self._stimulated_ns + _UNSEEN_NS
        if since_ns is None:
            return None
        seconds = (now_ns - since_ns) / NANOSECONDS_PER_SECOND
        done = self._choices
        due = _CHOICES_S[done] if done < len(_CHOICES_S) else _PERIOD_S * (done - 3)
        if seconds >= due:
            self._choices += 1
        elif not alike or now_ns < self._compared_ns + _AGAIN_NS:
            return None
        self._compared_ns = now_ns
        return Search.EVERYWHERE if done < _GRIDS or alike else Search.NEIGHBOURS
