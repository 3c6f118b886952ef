# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One session: pulses, force, and what can be asked of them."""

import html
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.identification import DEFAULT_RATE
from rpms_ros.identification.model.settings import PEOPLE_PRESET
from rpms_ros.identification.stream.arrivals import no_overlap
from rpms_ros.muscle import Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, IntArray, PulseTrain
from rpms_ros.recording import Recording, write_recording
from rpms_ros.recording.rosbag.verifying import Finding, verify
from rpms_ros.report.known_muscle import KnownMuscle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rpms_ros.api.identification import Identification

Fact = str | int | float | list[str] | dict[str, int] | None


@dataclass(frozen=True)
class Session:
    """Pulses and force of one session; made by `load` and `simulate`.

    Attributes
    ----------
    name : str
        What people call it; the title of figures.
    recording : Recording
        Everything that was read.
    subject : Subject or None
        The true muscle, of a simulated session or a recording of one; at rest, if it changes.
    truth : KnownMuscle or None
        The true muscle over a simulated session with a scenario; None without one, since the
        muscle stays `subject` then.
    imported : tuple of (str, str)
        How a file of a laboratory was read, and what was guessed with its reason.
    """

    name: str
    recording: Recording = field(repr=False)
    subject: Subject | None = field(default=None, repr=False)
    truth: KnownMuscle | None = field(default=None, repr=False)
    imported: tuple[tuple[str, str], ...] = field(default=(), repr=False)

    @property
    def pulses(self) -> PulseTrain:
        """Delivered pulses: ``onset_ns`` [ns], ``intensity`` (0 to 1), ``width`` [s]."""
        return self.recording.pulses

    @property
    def force(self) -> ForceTrace:
        """Force samples: ``stamp_ns`` [ns], ``force`` [N]."""
        return self.recording.forces

    @property
    def duration(self) -> float:
        """Time from the first to the last force sample [s]; 0 without samples."""
        stamps = self.force.stamp_ns
        return float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND if len(stamps) else 0.0

    def info(self) -> dict[str, Fact]:
        """Return what the session holds, in a few numbers.

        Returns
        -------
        dict
            ``name``, ``path``, ``storage``, ``samples``, ``pulses``, ``duration_s``,
            ``force_rate_hz`` and ``pulse_rate_hz`` (medians), ``unit`` of the force (or torque,
            in its two numbers, too), ``lowest_force_n``,
            ``highest_force_n``, ``lowest_intensity``, ``highest_intensity``, ``faults`` of the
            recording by kind, ``remarks`` on them and on pulses that do not overlap with the
            force, and how a file was ``imported``.  What cannot be told is None.
        """
        forces = self.force.force[np.isfinite(self.force.force)]
        facts, shares = self.recording.facts, self.pulses.intensity
        apart = no_overlap(self.pulses.onset_ns, self.force.stamp_ns)
        return {
            'name': self.name,
            'path': str(facts.path),
            'storage': facts.storage,
            'samples': len(self.force),
            'pulses': len(self.pulses),
            'duration_s': self.duration,
            'force_rate_hz': _rate(self.force.stamp_ns),
            'pulse_rate_hz': _rate(self.pulses.onset_ns),
            'unit': self.recording.unit,
            'lowest_force_n': float(forces.min()) if len(forces) else None,
            'highest_force_n': float(forces.max()) if len(forces) else None,
            'lowest_intensity': float(shares.min()) if len(shares) else None,
            'highest_intensity': float(shares.max()) if len(shares) else None,
            'faults': dict(facts.faults),
            'remarks': [*facts.remarks, *([] if apart is None else [apart])],
            'imported': [f'{label}: {text}' for label, text in self.imported],
        }

    def plot(self, figure: 'Figure | None' = None) -> 'Figure':
        """Draw the force and the intensity of each pulse over time; return the figure.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            An empty figure to draw into; else one is made by ``matplotlib.pyplot``, which shows
            it in a notebook, and in a script with ``plt.show()``.
        """
        figure = figure or new_figure(5.0)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        samples, onsets = self.force.stamp_ns, self.pulses.onset_ns
        # without samples time counts from the first pulse
        start = next((int(one.min()) for one in (samples, onsets) if len(one)), 0)
        time = (samples - start) / NANOSECONDS_PER_SECOND
        above.plot(time, self.force.force, 'k', linewidth=0.8)
        above.set_ylabel(f'{self.recording.quantity} [{self.recording.unit}]')
        below.vlines((onsets - start) / NANOSECONDS_PER_SECOND, 0.0, self.pulses.intensity)
        below.set(xlabel='time [s]', ylabel='intensity', ylim=(0.0, 1.05))
        figure.suptitle(self.name)
        return figure

    def _repr_html_(self) -> str:
        told = self.info().items()
        facts = (f'{name}: {fact}' for name, fact in told if fact not in (None, [], {}))
        return '<pre>' + html.escape('\n'.join(facts)) + '</pre>'

    def verify(self) -> list[Finding]:
        """Return what every check of the recording found: ``check``, ``state`` and ``text`` each.

        Raises
        ------
        RecordingError
            If the session is not a recording on the disk (`save` writes one) or cannot be read.
        """
        facts = self.recording.facts
        if facts.storage not in ('mcap', 'sqlite3'):
            fault = 'expected a session that was loaded from a recording'
            raise RecordingError(f'{fault}, got one of {facts.storage}; save() writes a recording')
        return verify(facts.path, lambda: self.recording)

    def save(self, path: str | Path, compression: str = '') -> None:
        """Write pulses and force as a recording of mcap with checksums.

        Parameters
        ----------
        path : str or Path
            Folder that does not exist yet.
        compression : str
            Of its chunks: empty, ``lz4`` or ``zstd``.

        Raises
        ------
        RecordingError
            If the folder exists or cannot be written.
        """
        what, source = (path, self.pulses, self.force), {'source': self.name}
        quantity = self.recording.quantity
        write_recording(*what, compression=compression, custom=source, quantity=quantity)

    def between(self, start: float, end: float) -> 'Session':
        """Return the part of the session from `start` to `end`, in s after its first sample.

        Infinity as the end stands for the end of the session, -infinity for its beginning.

        Raises
        ------
        RecordingError
            If `end` is not after `start`, one of them is no time, or there is no sample in
            between.
        """
        for at in (start, end):
            if not isinstance(at, Real):
                raise RecordingError(f'expected a time in s, got {at!r}')
        if not start < end:
            raise RecordingError(f'expected a start before the end, got {start} s and {end} s')
        forces, stamps = self.force, (self.force.stamp_ns, self.pulses.onset_ns)
        first_ns = forces.stamp_ns.min() if len(forces) else 0
        elapsed = ((one - first_ns) / NANOSECONDS_PER_SECOND for one in stamps)
        here, chosen = ((time >= start) & (time <= end) for time in elapsed)
        if not here.any():
            fault = f'expected force between {start} s and {end} s'
            raise RecordingError(f'{fault}, got {self.duration:.3f} s of it')
        before = np.concatenate(([0], np.cumsum(here)))
        part = replace(
            self.recording,
            pulses=self.pulses[chosen],
            forces=ForceTrace(forces.stamp_ns[here], forces.force[here], forces.frame_id),
            pulse_received_ns=self.recording.pulse_received_ns[chosen],
            force_received_ns=self.recording.force_received_ns[here],
            samples_before_pulse=before[self.recording.samples_before_pulse[chosen]],
            facts=replace(self.recording.facts, storage='part'),
        )
        return replace(self, name=f'{self.name}, {start:g} to {end:g} s', recording=part)

    def identify(
        self,
        estimator: str = 'batch',
        *,
        rate_hz: float = DEFAULT_RATE,
        preset: str | None = None,
        seed: int = 0,
        most_estimates: int = 1000,
        progress: Callable[[int], object] | None = None,
    ) -> 'Identification':
        """Return recruitment and dynamics of the muscle.

        Parameters
        ----------
        estimator : str
            ``batch`` (the whole session at once, with intervals), ``recursive`` (one pass, as
            the node by default), ``tracking`` (as on line, a muscle that changes), or one that
            another distribution registers.
        rate_hz : float
            Repetition rate for which the recruitment curve is stated [Hz].
        preset : str, optional
            ``arctan``: the arctangents of the paper alone as recruitment; ``paper_table_4`` or
            ``paper_table_5``, which reproduce the paper.
        seed : int
            Of the random start of the paper's recursion.
        most_estimates : int
            About so many estimates at most are kept of an estimator that runs on line, evenly
            spaced; ``batch`` makes one.  The last one is the same in any case.
        progress : callable, optional
            Called with the number of samples that were taken since the last call.

        Raises
        ------
        IdentificationError
            If there is no such estimator or preset, another option is not possible, or there is
            no force to learn from.
        ReportError
            If the data do not lead to finite forces.

        Examples
        --------
        >>> import rpms_ros
        >>> result = rpms_ros.load('bags/sample').identify()
        >>> result.estimator
        'batch'
        >>> bool(result.force_at(0.5).lower <= result.force_at(0.5).value)
        True
        """
        from rpms_ros.api.identification import Identification
        from rpms_ros.report.result import IdentificationOptions, identified, result_of

        chosen = PEOPLE_PRESET if preset is None else preset
        options = IdentificationOptions(estimator, chosen, rate_hz, seed)
        estimates = identified(self.recording, options, progress, most_estimates)
        return Identification(self, estimates, result_of(self.recording, estimates))


def new_figure(height: float) -> 'Figure':
    """Return a figure of ``matplotlib.pyplot``, which notebooks show, so high [inch]."""
    from matplotlib import pyplot as plt

    return plt.figure(figsize=(12.0, height), layout='constrained')


def _rate(stamp_ns: IntArray) -> float | None:
    """Return the median rate of ascending stamps [Hz], None if there is none."""
    steps = np.diff(stamp_ns)
    median = float(np.median(steps)) if len(steps) else 0.0
    return NANOSECONDS_PER_SECOND / median if median > 0 else None
