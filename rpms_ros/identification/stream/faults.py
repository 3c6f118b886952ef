# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of the faults of the data of an identification, each with its meaning."""

from collections.abc import Mapping

from rpms_ros.saved_state import Restorable, expect

FORCE_NOT_FINITE = 'force_not_finite'
FORCE_OUT_OF_BOUNDS = 'force_out_of_bounds'
FORCE_DUPLICATE = 'force_duplicate'
FORCE_CONFLICT = 'force_conflict'
FORCE_STAMP_NOT_AFTER_LAST = 'force_stamp_not_after_last'
FORCE_STAMP_ALONE = 'force_stamp_alone'
FORCE_GAP = 'force_gap'
FORCE_QUEUE_FULL = 'force_queue_full'
FORCE_SPIKE = 'force_spike'
FORCE_OUTLIER = 'force_outlier'
FORCE_ARTIFACT = 'force_artifact'
FORCE_ALTERNATING = 'force_alternating'
FORCE_FROZEN = 'force_frozen'
FORCE_CLIPPED = 'force_clipped'
FORCE_CONSTANT = 'force_constant'
FORCE_UNEXPLAINED = 'force_unexplained'
FORCE_PUBLISHERS = 'force_publishers'
CLOCK_JUMP = 'clock_jump'
PULSE_INTENSITY_INVALID = 'pulse_intensity_invalid'
PULSE_LOST = 'pulse_lost'
PULSE_LATE = 'pulse_late'
PULSE_DUPLICATE = 'pulse_duplicate'
PULSE_TOO_CLOSE = 'pulse_too_close'
PULSE_FAR_AHEAD = 'pulse_far_ahead'
PULSE_SEQUENCE_RESTART = 'pulse_sequence_restart'
PULSE_SEQUENCE_STUCK = 'pulse_sequence_stuck'
PULSE_PUBLISHERS = 'pulse_publishers'
SAMPLES_EXCLUDED = 'samples_excluded'
MONITOR_FAILED = 'monitor_failed'
PULSES_TOO_FREQUENT = 'pulses_too_frequent'
FACTORISATION_FAILED = 'factorisation_failed'

MEANING: Mapping[str, str] = {
    FORCE_NOT_FINITE: 'force samples that were NaN or infinite, dropped',
    FORCE_OUT_OF_BOUNDS: 'force samples beyond `largest_force`, dropped',
    FORCE_DUPLICATE: 'force samples that came twice, stamp and value; the second is dropped',
    FORCE_CONFLICT: 'force samples with the stamp of the one before and another value; neither is '
    'learnt from',
    FORCE_STAMP_NOT_AFTER_LAST: 'force samples stamped before their predecessor, dropped; from '
    'three a second on, as two sensors on one topic make them, learning waits',
    FORCE_STAMP_ALONE: 'force samples stamped far from those before and after them, dropped',
    FORCE_GAP: 'gaps in the force longer than allowed; learning waits for one memory after it',
    FORCE_QUEUE_FULL: 'force samples for which there was no room while they waited, dropped',
    FORCE_SPIKE: 'force samples that leave the course of their neighbours for less than 10 ms; '
    'not learnt from',
    FORCE_OUTLIER: 'force samples that jump away from their prediction and back within 20 ms '
    'while it was good before; not learnt from',
    FORCE_ARTIFACT: 'the same within 10 ms after a pulse, as a stimulation artifact; not learnt '
    'from',
    FORCE_ALTERNATING: 'force samples that jump between two courses, as two sensors on one topic '
    'do; not learnt from',
    FORCE_FROZEN: 'force samples of a sensor that repeats one value where it varied before; not '
    'learnt from',
    FORCE_CLIPPED: 'force samples at the end of the range of the sensor; not learnt from',
    FORCE_CONSTANT: 'force samples that had not changed in any bit for three seconds',
    FORCE_UNEXPLAINED: 'force samples far from their prediction while it was good before: a '
    'disturbance, or the muscle has changed',
    FORCE_PUBLISHERS: 'further publishers of the force on the graph of a node; all are heard',
    CLOCK_JUMP: 'jumps of the stamps back in time; pulses that still acted are forgotten',
    PULSE_INTENSITY_INVALID: 'pulses whose intensity was not within 0..1; treated as lost',
    PULSE_LOST: 'pulses missing in the sequence; learning stops while they could act',
    PULSE_LATE: 'pulses that came after their samples were used; treated as lost',
    PULSE_DUPLICATE: 'pulses that came twice; the second is dropped',
    PULSE_TOO_CLOSE: 'pulses less than 0.2 ms after another, or beyond 10,000 within a second, as '
    'no stimulator gives them; treated as lost',
    PULSE_FAR_AHEAD: 'pulses stamped more than 10 s after the force, which did not follow within '
    '10 s, or beyond 100,000 of them within a second of the force; dropped',
    PULSE_SEQUENCE_RESTART: 'sequences that started anew, as after a restart of the driver; '
    'learning waits if it happens twice within 10 s, as with two drivers',
    PULSE_SEQUENCE_STUCK: 'pulses of a driver that does not count them; losses cannot show',
    PULSE_PUBLISHERS: 'further publishers of the pulses on the graph of a node; all are heard',
    SAMPLES_EXCLUDED: (
        'force samples that were predicted but not learnt from; so at the start of a stream whose '
        'first pulse has another sequence number than 0, with no rest before it: earlier pulses '
        'still act'
    ),
    MONITOR_FAILED: 'monitors that raised an exception and were taken out',
    PULSES_TOO_FREQUENT: 'pulses between two samples for which the window has no room, dropped',
    FACTORISATION_FAILED: 'steps of an estimator that were not taken: matrix not positive',
}


class FaultCounter(Restorable):
    """Counts faults by name, at once or when the samples before them are processed.

    Parameters
    ----------
    further : mapping of str to str
        Faults besides `MEANING` that may be counted, with what they mean.
    """

    _counts: dict[str, int]
    _postponed: dict[tuple[int, str], int]

    def __init__(self, further: Mapping[str, str] | None = None) -> None:
        self._meaning = {**MEANING, **(further or {})}
        self._counts = {}
        self._postponed = {}

    def _check_restored(self) -> None:
        expect(set(self._counts) <= set(self._meaning), 'FaultCounter', 'known faults')

    def add(self, name: str, count: int = 1) -> None:
        """Count `count` more faults of a known kind."""
        if name not in self._meaning:
            raise KeyError(f'expected a fault of {", ".join(self._meaning)}, got {name}')
        if count:
            self._counts[name] = self._counts.get(name, 0) + count

    def postpone(self, name: str, after_ns: int | None) -> None:
        """Keep a fault that was found after a stamp [ns]; None: before the first."""
        # without one, earlier than any stamp
        key = (-(2**63) if after_ns is None else after_ns, name)
        self._postponed[key] = self._postponed.get(key, 0) + 1

    def count_until(self, until_ns: int | None) -> None:
        """Count what was found after stamps up to `until_ns`; None: everything."""
        for key in [key for key in self._postponed if until_ns is None or key[0] <= until_ns]:
            self.add(key[1], self._postponed.pop(key))

    def counts(self, postponed: bool = False) -> dict[str, int]:
        """Return the counts so far, in the order of the names; with `postponed`, those not due."""
        total = dict(self._counts)
        for (_, name), count in self._postponed.items() if postponed else ():
            total[name] = total.get(name, 0) + count
        return {name: total[name] for name in self._meaning if name in total}
