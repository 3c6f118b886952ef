# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether prediction errors follow the pulses: then the model's response is not the muscle's.

Noise, tremor and effort do not know of the pulses.  A response that begins too early, is too slow
for the functions of the model, or has become weaker does: its errors are the larger the stronger
the pulse was, and have the same course after each.  So they are regressed on the intensity of the
pulse before, apart for each 5 ms after it, and on the predicted force.
"""

import numpy as np

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

_BIN_NS = 5_000_000
_BINS = 20
# Sums of a lag: samples, intensity, its square, error, error times intensity, error squared.
_SUMS = 6
# Over all lags: samples, prediction, its square, error, error times prediction, force squared,
# error squared.
_ALL = 7
# So many seconds count, those with the largest errors left out: after a sudden change the
# muscle is learnt anew, and an effort of the patient is short.
_SECONDS, _LEFT_OUT = 12, 4
# An estimator learns first [s].
_SETTLING_S = 8
# Root mean square over the lags of the error of a pulse of full intensity, as a share of that of
# the force, and share by which the prediction is too small or too large.  Functions that begin
# 8 ms after the muscle have 1.6 %: the curve is then wrong by less than 1 %, which is no reason
# not to trust it.
_SHAPE, _GAIN = 0.025, 0.01
# Variance of a slope that noise explains, times this for noise whose neighbours are alike.
_CHANCE = 4.0
# Intensities that differ less do not tell the response from the baseline.
_LEAST_SPREAD = 0.05


class ResponseMisfit(Restorable):
    """Regression of the prediction errors on the pulses, over the last seconds."""

    _onset_ns: IntArray
    _intensity: FloatArray
    _by_lag: FloatArray
    _over_all: FloatArray
    _cell: int | None
    _cells: int

    def __init__(self) -> None:
        self.restart()

    def _check_restored(self) -> None:
        sums = self._by_lag.shape == (_SECONDS, _BINS, _SUMS)
        sums = sums and self._over_all.shape == (_SECONDS, _ALL) and self._cells >= 0
        pulses = self._onset_ns.shape == self._intensity.shape == (len(self._onset_ns),)
        expect(sums and pulses, 'ResponseMisfit', 'arrays of one size')

    def restart(self) -> None:
        """Forget everything: the clock has jumped."""
        self._onset_ns = np.empty(0, dtype=np.int64)
        self._intensity = np.empty(0)
        self._cell = None
        self._cells = 0
        self._by_lag = np.zeros((_SECONDS, _BINS, _SUMS))
        self._over_all = np.zeros((_SECONDS, _ALL))

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending [ns, 1]."""
        self._onset_ns = np.concatenate((self._onset_ns, onset_ns))
        self._intensity = np.concatenate((self._intensity, intensity))

    def add(
        self, stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
    ) -> None:
        """Add samples (samples,), ascending, whose pulses have been added [ns, N, N].

        The sums do not depend on how samples are cut into blocks, in no bit.
        """
        if not len(self._onset_ns):
            return
        cell = stamp_ns // NANOSECONDS_PER_SECOND
        starts = np.flatnonzero(np.diff(cell)) + 1
        for first, last in zip((0, *starts), (*starts, len(stamp_ns)), strict=True):
            if self._cell is not None and cell[first] != self._cell:
                self._cells += 1
                self._by_lag[self._newest] = 0.0
                self._over_all[self._newest] = 0.0
            self._cell = int(cell[first])
            part = slice(first, last)
            if self._cells >= _SETTLING_S:
                self._sum(stamp_ns[part], force[part], prediction[part], usable[part])
        begun = int(np.searchsorted(self._onset_ns, stamp_ns[-1], side='right'))
        self._onset_ns = self._onset_ns[max(begun - 1, 0) :]
        self._intensity = self._intensity[max(begun - 1, 0) :]

    def _sum(
        self, stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
    ) -> None:
        place = np.searchsorted(self._onset_ns, stamp_ns, side='right') - 1
        lag = (stamp_ns - self._onset_ns[np.maximum(place, 0)]) // _BIN_NS
        chosen = usable & (place >= 0) & (lag < _BINS) & np.isfinite(force - prediction)
        lag, place = lag[chosen], place[chosen]
        force, expected = force[chosen], prediction[chosen]
        error, intensity = force - expected, self._intensity[place]
        one = np.ones(len(error))
        # one after the other, so that no bit depends on the blocks
        columns = (one, intensity, intensity**2, error, error * intensity, error**2)
        np.add.at(self._by_lag[self._newest], lag, np.stack(columns, axis=1))
        rows = (one, expected, expected**2, error, error * expected, force**2, error**2)
        whole = self._over_all[self._newest, None]
        np.add.at(whole, np.zeros(len(one), dtype=np.int64), np.stack(rows, axis=1))

    @property
    def _newest(self) -> int:
        return self._cells % _SECONDS

    @property
    def sizes(self) -> tuple[float, float]:
        """Error of the response's shape and of its size, as shares of the force; 0 if unknown."""
        counted = np.argsort(self._over_all[:, -1], kind='stable')[: _SECONDS - _LEFT_OUT]
        samples, prediction, squares, error, product, power, _ = self._over_all[counted].sum(0)
        if self._cells < _SETTLING_S + _SECONDS or not power > 0.0:
            return 0.0, 0.0
        spread = squares - prediction**2 / samples
        gain = (product - error * prediction / samples) / spread if spread > 0.0 else 0.0
        by_lag = self._by_lag[counted].sum(0)
        some = by_lag[by_lag[:, 0] > 0.0]
        count, intensity, its_square, error_there, both, its_noise = some.T
        varied = its_square - intensity**2 / count
        enough = varied > count * _LEAST_SPREAD**2
        slope = (both - error_there * intensity / count)[enough] / varied[enough]
        if not enough.any():
            return 0.0, abs(float(gain))
        by_chance = (its_noise / count)[enough] / varied[enough]
        mean_square = float(np.average(slope**2 - _CHANCE * by_chance, weights=count[enough]))
        return float(np.sqrt(max(mean_square, 0.0) * samples / power)), abs(float(gain))

    @property
    def doubted(self) -> bool:
        """Whether the errors follow the pulses."""
        shape, gain = self.sizes
        return shape > _SHAPE or gain > _GAIN
