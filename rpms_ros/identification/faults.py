"""Names of what can go wrong with the data of an identification, each with its meaning."""

FORCE_NOT_FINITE = 'force_not_finite'
FORCE_STAMP_NOT_AFTER_LAST = 'force_stamp_not_after_last'
FORCE_STAMP_ALONE = 'force_stamp_alone'
FORCE_GAP = 'force_gap'
CLOCK_JUMP = 'clock_jump'
PULSE_INTENSITY_INVALID = 'pulse_intensity_invalid'
PULSE_LOST = 'pulse_lost'
PULSE_LATE = 'pulse_late'
PULSE_DUPLICATE = 'pulse_duplicate'
PULSE_SEQUENCE_RESTART = 'pulse_sequence_restart'
PULSE_SEQUENCE_STUCK = 'pulse_sequence_stuck'
SAMPLES_EXCLUDED = 'samples_excluded'

MEANING = {
    FORCE_NOT_FINITE: 'force samples that were NaN or infinite, dropped',
    FORCE_STAMP_NOT_AFTER_LAST: 'force samples stamped like or before their predecessor, dropped',
    FORCE_STAMP_ALONE: 'force samples stamped far from those before and after them, dropped',
    FORCE_GAP: 'gaps in the force longer than allowed; learning waits for one memory after it',
    CLOCK_JUMP: 'jumps of the stamps back in time; pulses that still acted are forgotten',
    PULSE_INTENSITY_INVALID: 'pulses whose intensity was not within 0..1; treated as lost',
    PULSE_LOST: 'pulses missing in the sequence; learning stops while they could act',
    PULSE_LATE: 'pulses that came after their samples were used; treated as lost',
    PULSE_DUPLICATE: 'pulses that came twice; the second is dropped',
    PULSE_SEQUENCE_RESTART: 'sequences that started anew, as after a restart of the driver',
    PULSE_SEQUENCE_STUCK: 'pulses of a driver that does not count them; losses cannot show',
    SAMPLES_EXCLUDED: 'force samples that were predicted but not learnt from',
}


class FaultCounter:
    """Counts faults by name."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def add(self, name: str, count: int = 1) -> None:
        """Count `count` more faults of a kind named in `MEANING`."""
        if name not in MEANING:
            raise KeyError(f'expected a fault of {", ".join(MEANING)}, got {name}')
        if count:
            self._counts[name] = self._counts.get(name, 0) + count

    def counts(self) -> dict[str, int]:
        """Return the counts so far, in the order of `MEANING`: no order of arrival shows in it."""
        return {name: self._counts[name] for name in MEANING if name in self._counts}
