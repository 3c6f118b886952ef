# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pseudo-random multilevel sequence: few levels in an order whose spectrum is flat.

A shift register of ``order`` cells over the integers modulo a prime q, fed back by a primitive
polynomial, runs through all q**order - 1 states but zero before it repeats, so every level comes
as often as the others (zero once less) and the sequence is uncorrelated with its own shifts.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import FloatArray
from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import share
from rpms_ros.stimulation.repetitive import SEED
from rpms_ros.stimulation.repetitive import Repetitive
from rpms_ros.stimulation.repetitive import refuse_swapped

PRIMES = (2, 3, 5, 7)


# Coefficients of a primitive polynomial for each number of levels and of cells: to look for them
# takes seconds.
FEEDBACK: dict[tuple[int, int], tuple[int, ...]] = {
    (2, 1): (1,),
    (2, 2): (1, 1),
    (2, 3): (1, 0, 1),
    (2, 4): (1, 0, 0, 1),
    (3, 1): (2,),
    (3, 2): (1, 1),
    (3, 3): (2, 0, 1),
    (3, 4): (1, 0, 0, 1),
    (5, 1): (2,),
    (5, 2): (2, 2),
    (5, 3): (2, 0, 1),
    (5, 4): (2, 0, 2, 1),
    (7, 1): (3,),
    (7, 2): (2, 2),
    (7, 3): (3, 0, 1),
    (7, 4): (2, 0, 1, 1),
}


@lru_cache(maxsize=32)
def maximal_sequence(symbols: int, order: int) -> tuple[int, ...]:
    """Return one period of a maximal-length sequence.

    Parameters
    ----------
    symbols : int
        Number of levels q, a prime.
    order : int
        Cells of the shift register.

    Returns
    -------
    tuple of int, length symbols**order - 1
        Symbols 0 .. q-1.
    """
    feedback = FEEDBACK.get((symbols, order))
    if feedback is None:
        raise StimulationError(
            f'expected 2, 3, 5 or 7 levels and 1 to 4 cells, got {symbols} and {order}'
        )
    return _run(feedback, symbols, symbols**order - 1)


def _run(feedback: tuple[int, ...], symbols: int, longest: int) -> tuple[int, ...]:
    """Return the symbols until the register's first state comes back, at most ``longest``."""
    start = (0,) * (len(feedback) - 1) + (1,)
    state = start
    sequence = []
    for _ in range(longest):
        sequence.append(state[0])
        new = sum(c * s for c, s in zip(feedback, state, strict=True)) % symbols
        state = (*state[1:], new)
        if state == start:
            return tuple(sequence)
    return ()


@dataclass(frozen=True)
class MultilevelPRBS(Repetitive):
    """A maximal-length sequence of ``level_count`` levels from ``low`` to ``high``.

    Attributes
    ----------
    level_count : int
        Number of levels: 2, 3, 5 or 7.
    order : int
        Cells of the shift register; the sequence repeats after level_count**order - 1 levels.
    hold_pulses : int
        Pulses given at a level before the next.
    seed : int, optional
        Where in its period the sequence begins; drawn from the schedule's seed if it is missing.
    """

    kind: ClassVar[str] = 'multilevel_prbs'
    low: float = share(0.0)
    high: float = share(1.0)
    level_count: int = bounded(Bound(2, 7, whole=True), 5)
    order: int = bounded(Bound(1, 4, whole=True), 3)
    hold_pulses: int = bounded(Bound(1, 100_000, whole=True), 1)
    seed: int | None = bounded(SEED, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_swapped(self.low, self.high)
        if self.level_count not in PRIMES:
            raise StimulationError(
                f'expected a level_count of 2, 3, 5 or 7, got {self.level_count}'
            )

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the levels, each held, from a place in the period that the seed chooses."""
        own = random if self.seed is None else np.random.default_rng(self.seed)
        period = np.asarray(maximal_sequence(self.level_count, self.order), dtype=np.float64)
        start = int(own.integers(len(period)))
        step = start + np.arange(len(onset_s)) // self.hold_pulses
        symbol = period[step % len(period)]
        return self.low + (self.high - self.low) * (symbol / (self.level_count - 1))
