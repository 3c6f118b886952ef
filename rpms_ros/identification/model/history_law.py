# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The history law: how earlier pulses of a train change the effect of later ones.

Pulse q is facilitated by the earlier ones, whose effect decays,

.. math:: p_q = 1 + a \sum_{j<q} e^{-(t_q - t_j) / \tau_p}

(potentiation and the doublet effect).  The weighted twitches add up to an activation
``x = sum_q p_q F(t - t_q)`` (Eqs. 5, 6), and the force rises with it cooperatively at low
activation and saturates at high activation, ``S(x) = (1 + k^h) x^h / (k^h + x^h)``.

An estimator adds weighted responses, but the law is not linear.  So each pulse gets the weight for
which the sum of the weighted twitches equals the force of the law at the peak of that pulse's own
twitch,

.. math:: r_q = S\Big(\sum_{j \le q} p_j F(t^* - t_j)\Big) - \sum_{j < q} r_j F(t^* - t_j),
          \qquad t^* = t_q + (n - 1) T_a .

It depends on earlier pulses only.  The series lag of the law is part of the response.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.muscle.recruitment import REFRACTORY_NS
from rpms_ros.muscle.twitch import twitch
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, nanoseconds


@dataclass(frozen=True)
class HistoryLaw:
    """Parameters of the history law.

    Attributes
    ----------
    half_level : float
        k, activation at half the greatest force, in peaks of a single twitch.
    cooperation : float
        h, exponent.
    facilitation : float
        a, increase of the gain of the next pulse by one pulse.
    facilitation_decay : float
        tau_p [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    # what has to be above zero
    POSITIVE: ClassVar[tuple[str, ...]] = ('half_level', 'cooperation', 'facilitation_decay')

    half_level: float = 3.0
    cooperation: float = 1.5
    facilitation: float = 0.3
    facilitation_decay: float = 0.1

    def __post_init__(self) -> None:
        for name in self.POSITIVE:
            check_number(IdentificationError, name, getattr(self, name), 0, above=True)
        check_number(IdentificationError, 'facilitation', self.facilitation, 0)

    def saturated(self, activation: FloatArray) -> FloatArray:
        """Return S(x) of activations, 1 at 1 and 0 below 0."""
        power = np.maximum(activation, 0.0) ** self.cooperation
        level = self.half_level**self.cooperation
        force: FloatArray = (1.0 + level) * power / (level + power)
        return force


# After so many time constants a twitch is below a millionth of its peak.
_TWITCH_SPAN = 24.0
_STEADY_PULSES = 200
# T_a of the weighted twitches, as share of that of equal pulses.  Fitted with the law it is 0.48
# of it, with a series lag behind; without the lag 0.65 explains the rat's trains better than 0.5.
_SHARE_OF_EQUAL = 0.65
_LARGEST_FILE = 64_000_000
# Whatever its unit, no number of a law is near this.
_LARGEST_NUMBER = 1e9


@dataclass(frozen=True)
class TemporalSummation(HistoryLaw):
    """History law, and its twitches.

    Attributes
    ----------
    time_constant : float
        T_a of the twitches [s].
    order : int
        n, number of equal poles of the twitches.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    POSITIVE = (*HistoryLaw.POSITIVE, 'time_constant')

    time_constant: float = 25e-3
    order: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number(IdentificationError, 'order', self.order, 2)

    @classmethod
    def of_analysis(cls, document: Mapping[str, Any]) -> 'TemporalSummation':
        """Return the law from the JSON of ``rpms analyze``, or from its parameters by name.

        Raises
        ------
        IdentificationError
            If the document has neither.
        """
        numbers: dict[str, Any] = dict(document)
        if 'summation' in numbers:
            found = numbers['summation']
            if not isinstance(found, Mapping) or not isinstance(found.get('law'), Mapping):
                raise IdentificationError('expected an analysis with a history law, got none')
            numbers = {**found['law'], 'order': found.get('order')}
            numbers.pop('series_lag', None)
            constant = found.get('time_constant')
            if isinstance(constant, float):
                numbers['time_constant'] = _SHARE_OF_EQUAL * constant
        names = {field.name for field in fields(cls)}
        for name, value in numbers.items():
            if name not in names:
                raise IdentificationError(
                    f'expected {", ".join(sorted(names))} of a history law, got {name!r}'
                )
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise IdentificationError(f'expected a number for {name}, got {value!r}')
            if abs(value) >= _LARGEST_NUMBER:
                raise IdentificationError(
                    f'expected {name} below {_LARGEST_NUMBER:g}, got {value!r:.40}'
                )
        order = numbers.get('order', 3)
        if math.isnan(order) or order != int(order):
            raise IdentificationError(f'expected a whole order, got {order}')
        return cls(**{**numbers, 'order': int(order)})

    @classmethod
    def of_file(cls, path: Path | str) -> 'TemporalSummation':
        """Return the law from a JSON file; see `of_analysis`.

        Raises
        ------
        IdentificationError
            If it cannot be read, or holds no history law.
        """
        try:
            if not Path(path).is_file() or Path(path).stat().st_size > _LARGEST_FILE:
                raise IdentificationError(f'expected a JSON file with a history law, got {path}')
            document = json.loads(Path(path).read_text())
        except (OSError, ValueError, RecursionError) as error:
            raise IdentificationError(f'expected a JSON file, got {path}: {error}') from error
        if not isinstance(document, dict):
            raise IdentificationError(f'expected a JSON object in {path}, got another value')
        return cls.of_analysis(document)


class PulseHistory:
    """Computes the weights of pulses one after another.

    Parameters
    ----------
    law : TemporalSummation
        The history law.
    rate_hz : float
        Rate at which the weight of a steady train is 1 [Hz].
    """

    def __init__(self, law: TemporalSummation, rate_hz: float) -> None:
        self._law = law
        self._span_ns = nanoseconds(_TWITCH_SPAN * law.time_constant)
        self._unit = 1.0
        self.forget()
        interval = max(round(NANOSECONDS_PER_SECOND / rate_hz), REFRACTORY_NS)
        steady = interval * np.arange(_STEADY_PULSES, dtype=np.int64)
        unit = float(self.weights(steady, np.ones(_STEADY_PULSES))[-1])
        if not unit > 0.0:
            raise IdentificationError(
                f'expected a history law with force left at {rate_hz} Hz, got {law}'
            )
        self._unit = unit
        self.forget()

    def forget(self) -> None:
        """Forget all pulses: the next one counts as the first."""
        self._onset_ns, self._gain, self._weight = np.empty(0, np.int64), np.empty(0), np.empty(0)
        self._left = 0.0

    def weights(self, onset_ns: IntArray, intensity: FloatArray) -> FloatArray:
        """Return the weights (pulses,) of the next pulses, ascending [ns, 1].

        A pulse of intensity 0 does not change the weights of later ones.
        """
        found = np.empty(len(onset_ns))
        for index, onset in enumerate(onset_ns.tolist()):
            found[index] = self._weigh(onset, bool(intensity[index] > 0.0))
        return found / self._unit

    def _weigh(self, onset_ns: int, acts: bool) -> float:
        law = self._law
        left = 0.0
        if len(self._onset_ns):
            since_ns = max(onset_ns - int(self._onset_ns[-1]), REFRACTORY_NS)
            left = (self._left + 1.0) * math.exp(-1e-9 * since_ns / law.facilitation_decay)
        gain = 1.0 + law.facilitation * left
        recent = self._onset_ns > onset_ns - self._span_ns
        peak = (law.order - 1) * law.time_constant
        lag = 1e-9 * np.maximum(onset_ns - self._onset_ns[recent], REFRACTORY_NS) + peak
        shape = twitch(lag, law.time_constant, law.order)
        activation = gain + self._gain[recent] @ shape
        weight = float(law.saturated(activation) - self._weight[recent] @ shape)
        weight = max(weight, 0.0)
        if acts:
            # The newest pulse is always kept: the facilitation decays from its onset on.
            self._onset_ns = np.append(self._onset_ns[recent], onset_ns)
            self._gain = np.append(self._gain[recent], gain)
            self._weight = np.append(self._weight[recent], weight)
            self._left = left
        return weight
