# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples and pulses of the window, from which blocks of another basis are made."""

import copy
from itertools import pairwise

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.block_statistics import empty_blocks
from rpms_ros.identification.projection.data_intake import Intake
from rpms_ros.identification.projection.data_intake import fresh_intake
from rpms_ros.identification.projection.data_intake import take
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.projection.problem import pass_arrays
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.identification.tracking.tremor import polynomials
from rpms_ros.identification.tracking.tremor import seconds
from rpms_ros.identification.tracking.tremor import waves
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Least distance of samples that are kept: more are not needed to choose a basis [ns].
_LEAST_DISTANCE_NS = 900_000
# A tremor is subtracted in pieces of a second with at least so many samples, fitted together with
# a polynomial of so many terms.
_LEAST_IN_PIECE, _SLOW = 30, 4
_ARRAYS = ('_stamp_ns', '_measured', '_force')


class RawSamples(Restorable):
    """Usable samples and pulses of the last seconds."""

    _stamp_ns: IntArray
    _measured: FloatArray
    _force: FloatArray
    _size: int
    _onset_ns: IntArray
    _intensity: FloatArray
    _weight: FloatArray

    def __init__(self) -> None:
        self.forget()

    def _check_restored(self) -> None:
        samples = {len(getattr(self, name)) for name in _ARRAYS}
        pulses = {len(self._onset_ns), len(self._intensity), len(self._weight)}
        fits = len(samples) == len(pulses) == 1 and 0 <= self._size <= len(self._force)
        expect(fits, 'RawSamples', 'as many forces as stamps')

    def forget(self) -> None:
        """Forget everything."""
        self._stamp_ns = np.zeros(4096, dtype=np.int64)
        self._measured = np.zeros(4096)
        self._force = np.zeros(4096)
        self._size = 0
        self._onset_ns = np.empty(0, dtype=np.int64)
        self._intensity = np.empty(0)
        self._weight = np.empty(0)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray) -> None:
        """Add pulses (pulses,), ascending, with the factor of their recruitment."""
        self._onset_ns = np.concatenate((self._onset_ns, onset_ns))
        self._intensity = np.concatenate((self._intensity, intensity))
        self._weight = np.concatenate((self._weight, weight))

    def add(
        self, stamp_ns: IntArray, force: FloatArray, tremor: FloatArray, usable: BoolArray
    ) -> None:
        """Add the usable ones of ascending samples (samples,), and the tremor in their force."""
        last = int(self._stamp_ns[self._size - 1]) if self._size else -(2**62)
        stamp_ns = stamp_ns[usable]
        kept = _thinned(stamp_ns, last)
        need = self._size + len(kept)
        if need > len(self._force):
            for name in _ARRAYS:
                old = getattr(self, name)
                larger = np.zeros(2 * need - len(old), dtype=old.dtype)
                setattr(self, name, np.concatenate((old, larger)))
        self._stamp_ns[self._size : need] = stamp_ns[kept]
        self._measured[self._size : need] = force[usable][kept]
        self._force[self._size : need] = (force - tremor)[usable][kept]
        self._size = need

    def drop(self, before_ns: int) -> None:
        """Drop what lies before a time [ns], once it is a quarter of what is kept."""
        first = int(np.searchsorted(self._stamp_ns[: self._size], before_ns))
        if first > self._size // 4:
            kept = self._size - first
            for name in _ARRAYS:
                values = getattr(self, name)
                values[:kept] = values[first : self._size].copy()
            self._size = kept
            pulse = int(np.searchsorted(self._onset_ns, before_ns - 2 * NANOSECONDS_PER_SECOND))
            self._onset_ns = self._onset_ns[pulse:]
            self._intensity = self._intensity[pulse:]
            self._weight = self._weight[pulse:]

    def newest_pulses(self, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return onset [ns], intensity and weight of the newest pulses (count,)."""
        first = len(self._onset_ns) - count
        return self._onset_ns[first:], self._intensity[first:], self._weight[first:]

    def condensed(
        self,
        basis: LaguerreBasis,
        theta: FloatArray,
        linear: FloatArray,
        first_ns: int,
        prior: Prior,
        capacity: int | None = None,
    ) -> tuple[Problem, Intake, int]:
        """Return the blocks of another basis, from a time on.

        Parameters
        ----------
        basis : LaguerreBasis
            Functions behind a latency.
        theta, linear : ndarray (4,), (functions,)
            The muscle, for the states of the intake.
        first_ns : int
            Samples from here on are fitted [ns]; pulses before lead the state up to it.
        prior : Prior
            Goes with the problem.
        capacity : int or None
            Room for blocks; None for what is needed.

        Returns
        -------
        tuple
            Problem, intake at the newest sample, and how many pulses have not begun to act.
        """
        fit = empty_fit(theta, basis.functions, 2)
        fit.linear[:] = linear
        problem, intake, pending, _ = self._into_blocks(basis, fit, first_ns, prior, capacity)
        return problem, intake, pending

    def rest(
        self,
        basis: LaguerreBasis,
        theta: FloatArray,
        linear: FloatArray,
        prior: Prior,
        first_ns: int = -(2**62),
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return stamps [ns], measured force [N] and what a muscle leaves of it [N] (samples,).

        Parameters
        ----------
        basis : LaguerreBasis
            Functions behind a latency.
        theta, linear : ndarray (4,), (functions,)
            The muscle.
        prior : Prior
            Of no consequence.
        first_ns : int
            The first sample that counts [ns].
        """
        low = int(np.searchsorted(self._stamp_ns[: self._size], first_ns))
        stamp_ns = self._stamp_ns[low : self._size]
        force = self._measured[low : self._size]
        if not len(stamp_ns):
            return stamp_ns, force, force
        fit = empty_fit(theta, basis.functions, 2)
        fit.linear[:] = linear
        muscle = self._into_blocks(basis, fit, int(stamp_ns[0]), prior, None)[-1]
        return stamp_ns, force, force - muscle

    def without(self, hertz: float, rest: FloatArray) -> 'RawSamples':
        """Return the same samples with a tremor taken off, piece by piece.

        Parameters
        ----------
        hertz : float
            Frequency of the tremor.
        rest : ndarray (samples,)
            What the muscle leaves [N], see `rest`.
        """
        result = copy.deepcopy(self)
        if not self._size:
            return result
        stamp_ns = self._stamp_ns[: self._size]
        first_ns = int(stamp_ns[0])
        piece = (stamp_ns - first_ns) // NANOSECONDS_PER_SECOND
        edges = np.flatnonzero(np.diff(piece, prepend=-1, append=-1))
        for first, last in pairwise(edges):
            if last - first < _LEAST_IN_PIECE:
                continue
            here = seconds(stamp_ns[first:last] - first_ns)
            wave, slow = waves(hertz, here), polynomials(here, _SLOW)
            found = np.linalg.lstsq(np.hstack((wave, slow)), rest[first:last], rcond=None)[0]
            result._force[first:last] = self._measured[first:last] - wave @ found[:2]
        return result

    def _into_blocks(
        self,
        basis: LaguerreBasis,
        fit: Fit,
        first_ns: int,
        prior: Prior,
        capacity: int | None,
    ) -> tuple[Problem, Intake, int, FloatArray]:
        """See `condensed`; and the force of the muscle at the samples."""
        low = int(np.searchsorted(self._stamp_ns[: self._size], first_ns))
        stamp_ns, force = self._stamp_ns[low : self._size], self._force[low : self._size]
        memory_ns = round(basis.duration * NANOSECONDS_PER_SECOND)
        pulse = int(np.searchsorted(self._onset_ns, first_ns - memory_ns))
        begin_ns = self._onset_ns[pulse:] + round(basis.latency * NANOSECONDS_PER_SECOND)
        span_ns = int(stamp_ns[-1] - stamp_ns[0]) if len(stamp_ns) else 0
        need = len(begin_ns) + span_ns // 200_000_000 + 8
        functions = basis.functions
        problem = Problem(
            blocks=empty_blocks(max(need, capacity or 0), functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=BaselineKnots(2, first_ns, NANOSECONDS_PER_SECOND),
            prior=prior,
            work=pass_arrays(functions),
        )
        prediction = np.empty(len(stamp_ns))
        intake = fresh_intake(functions)
        begun = take(
            stamp_ns,
            force,
            np.ones(len(stamp_ns), dtype=np.bool_),
            begin_ns,
            self._intensity[pulse:],
            self._weight[pulse:],
            problem,
            intake,
            fit,
            2.0 / basis.time_constant,
            prediction,
        )
        size = int(problem.blocks.size[0])
        first = int(np.searchsorted(problem.blocks.start_ns[:size], first_ns))
        problem = problem._replace(first=min(first, max(size - 1, 0)))
        return problem, intake, len(begin_ns) - begun, prediction


def _thinned(stamp_ns: IntArray, last_ns: int) -> IntArray:
    """Return which of ascending stamps (samples,) to keep, whatever the cut into blocks was."""
    bins = stamp_ns // _LEAST_DISTANCE_NS
    before = np.concatenate(([last_ns // _LEAST_DISTANCE_NS], bins[:-1]))
    return np.flatnonzero(bins != before)
