# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All usable samples and all pulses of a recording, to be condensed for any basis."""

from itertools import pairwise
from typing import NamedTuple
from typing import TypeVar

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.block_statistics import LONGEST_BLOCK_NS
from rpms_ros.identification.projection.block_statistics import empty_blocks
from rpms_ros.identification.projection.data_intake import Intake
from rpms_ros.identification.projection.data_intake import fresh_intake
from rpms_ros.identification.projection.data_intake import take
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.projection.problem import pass_arrays
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

Array = TypeVar('Array', IntArray, FloatArray)

_ROOM = 4096


class Part(NamedTuple):
    """Samples and pulses between two jumps of the clock, as slices of the record."""

    samples: slice
    pulses: slice


class SampleRecord(Restorable):
    """Usable samples and pulses since the start; its memory grows with the recording."""

    _stamp_ns: IntArray
    _force: FloatArray
    _size: int
    _onset_ns: IntArray
    _pulse: FloatArray
    _pulses: int
    _jumps: list[tuple[int, int]]

    def __init__(self) -> None:
        self._stamp_ns = np.zeros(_ROOM, dtype=np.int64)
        self._force = np.zeros(_ROOM)
        self._size = 0
        self._onset_ns = np.zeros(_ROOM, dtype=np.int64)
        # intensity and weight
        self._pulse = np.zeros((_ROOM, 2))
        self._pulses = 0
        self._jumps = []

    def _check_restored(self) -> None:
        samples = self._stamp_ns.shape == self._force.shape == (len(self._force),)
        pulses = self._pulse.shape == (len(self._onset_ns), 2) and self._onset_ns.ndim == 1
        within = 0 <= self._size <= len(self._force) and 0 <= self._pulses <= len(self._onset_ns)
        places = np.array([(0, 0), *self._jumps, (self._size, self._pulses)])
        ordered = bool((np.diff(places, axis=0) >= 0).all())
        expect(samples and pulses and within and ordered, 'SampleRecord', 'arrays of one size')

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray) -> None:
        """Add pulses (pulses,), ascending, with the factor of their recruitment."""
        end = self._pulses + len(onset_ns)
        self._onset_ns = _grown(self._onset_ns, end)
        self._pulse = _grown(self._pulse, end)
        self._onset_ns[self._pulses : end] = onset_ns
        self._pulse[self._pulses : end] = np.stack((intensity, weight), axis=1)
        self._pulses = end

    def add(self, stamp_ns: IntArray, force: FloatArray) -> None:
        """Add usable samples (samples,), ascending."""
        end = self._size + len(stamp_ns)
        self._stamp_ns = _grown(self._stamp_ns, end)
        self._force = _grown(self._force, end)
        self._stamp_ns[self._size : end] = stamp_ns
        self._force[self._size : end] = force
        self._size = end

    def jump(self) -> None:
        """Note that the clock has jumped: earlier pulses do not act on later samples."""
        self._jumps.append((self._size, self._pulses))

    def parts(self) -> list[Part]:
        """Return the parts between jumps, in order."""
        edges = [(0, 0), *self._jumps, (self._size, self._pulses)]
        return [
            Part(slice(first[0], last[0]), slice(first[1], last[1]))
            for first, last in pairwise(edges)
        ]

    def newest_pulses(self, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return onset [ns], intensity and weight of the newest pulses (count,)."""
        here = slice(self._pulses - count, self._pulses)
        return self._onset_ns[here], self._pulse[here, 0], self._pulse[here, 1]

    def window(self, longest_ns: int) -> Part | None:
        """Return the samples that choose a basis: the longest part, from its first strong pulse.

        A pulse is strong with half of the highest intensity.  None if there is no such part.
        """
        part = max(self.parts(), key=lambda one: one.samples.stop - one.samples.start)
        stamps, onsets = self._stamp_ns[part.samples], self._onset_ns[part.pulses]
        if not len(stamps):
            return None
        # how far ahead of the samples pulses are known must not matter
        onsets = onsets[: np.searchsorted(onsets, stamps[-1])]
        intensity = self._pulse[part.pulses, 0][: len(onsets)]
        if not intensity.max(initial=0.0) > 0.0:
            return None
        strong = int(np.argmax(intensity >= 0.5 * intensity.max()))
        ends_ns = int(onsets[strong]) + longest_ns
        edges = np.searchsorted(stamps, [int(onsets[strong]), ends_ns]) + part.samples.start
        last = int(np.searchsorted(onsets, ends_ns)) + part.pulses.start
        return Part(slice(int(edges[0]), int(edges[1])), slice(part.pulses.start, last))

    def span_ns(self, part: Part) -> tuple[int, int]:
        """Return the first and the last stamp of a part that has samples [ns]."""
        return int(self._stamp_ns[part.samples.start]), int(self._stamp_ns[part.samples.stop - 1])

    def condensed(
        self, basis: LaguerreBasis, prior: Prior, baseline: BaselineKnots, parts: list[Part]
    ) -> tuple[Problem, Intake, int]:
        """Return the samples of parts, condensed into blocks for a basis.

        Parameters
        ----------
        basis : LaguerreBasis
            The basis.
        prior : Prior
            Prior of the problem.
        baseline : BaselineKnots
            Baseline of the problem.
        parts : list of Part
            Samples that are fitted; pulses before the first sample advance its state.

        Returns
        -------
        tuple
            Problem, intake at the newest sample, and how many pulses have not begun to act.
        """
        need = 8
        for part in parts:
            if part.samples.start < part.samples.stop:
                first_ns, last_ns = self.span_ns(part)
                need += (last_ns - first_ns) // (LONGEST_BLOCK_NS // 2) + 8
            need += part.pulses.stop - part.pulses.start
        functions = basis.functions
        problem = Problem(
            blocks=empty_blocks(need, functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=baseline,
            prior=prior,
            work=pass_arrays(functions),
        )
        # its predictions are not used
        fit = empty_fit(np.ones(4), functions, baseline.knots)
        intake = fresh_intake(functions)
        waiting = 0
        latency_ns = round(basis.latency * NANOSECONDS_PER_SECOND)
        for part in parts:
            intake.fresh[0] = 1.0
            stamps = self._stamp_ns[part.samples]
            begin_ns = self._onset_ns[part.pulses] + latency_ns
            begun = take(
                stamps,
                self._force[part.samples],
                np.ones(len(stamps), dtype=np.bool_),
                begin_ns,
                np.ascontiguousarray(self._pulse[part.pulses, 0]),
                np.ascontiguousarray(self._pulse[part.pulses, 1]),
                problem,
                intake,
                fit,
                2.0 / basis.time_constant,
                np.empty(len(stamps)),
            )
            waiting = len(begin_ns) - begun
        return problem, intake, waiting


def _grown(values: Array, least: int) -> Array:
    """Return the values in an array with room for so many rows."""
    if least <= len(values):
        return values
    larger = np.zeros((max(least, 2 * len(values)), *values.shape[1:]), dtype=values.dtype)
    larger[: len(values)] = values
    return larger
