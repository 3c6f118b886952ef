# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of a recording: results of each kind of pulse group, and why results are missing."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.recruitment_field import (
    FieldAnalysis,
    SteadyPoint,
    fit_field,
    resting_force,
    steady_point,
)
from rpms_ros.identification.analysis.responses import (
    LEFT_OVER,
    Artifacts,
    Kind,
    Response,
    clean,
    counted_reasons,
    cut,
    find_artifacts,
    groups_of,
    without_artifacts,
)
from rpms_ros.identification.analysis.trains import MOST_PULSES, SummationAnalysis, analyze_trains
from rpms_ros.identification.analysis.twitches import TwitchAnalysis, analyze_twitches
from rpms_ros.identification.stream.arrivals import outside_shares
from rpms_ros.muscle import RateRecruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, IntArray, PulseTrain, nanoseconds


@dataclass(frozen=True)
class MuscleAnalysis:
    """Results of the analysis of a recording.

    Attributes
    ----------
    contents : mapping of str to int
        Groups of pulses by kind.
    pulses, samples : int
        Pulses within the force, and force samples.
    sample_rate_hz : float
        Median rate of the force [Hz].
    noise : float
        Standard deviation of the white noise of the sensor [N].
    artifacts : Artifacts or None
        Stimulation artifacts and the offset of the clocks; None without pulses.
    twitches : TwitchAnalysis or None
        From single pulses.
    summation : SummationAnalysis or None
        From trains.
    steady : tuple of SteadyPoint
        Steady forces of long levels.
    recruitment : FieldAnalysis or None
        From the steady forces.
    findings : tuple of str
        Irregularities, and why results are missing; a sentence each.
    unit : str
        Of every force: ``N``, or ``N m`` where the sensor measured a torque.
    """

    contents: Mapping[str, int]
    pulses: int
    samples: int
    sample_rate_hz: float
    noise: float
    artifacts: Artifacts | None
    twitches: TwitchAnalysis | None
    summation: SummationAnalysis | None
    steady: tuple[SteadyPoint, ...]
    recruitment: FieldAnalysis | None
    findings: tuple[str, ...]
    unit: str = 'N'


_ALIKE = 2e-3

# label, done, all
Progress = Callable[[str, int, int], None]


def analyze(
    pulses: PulseTrain, force: ForceTrace, progress: Progress = lambda *_: None
) -> MuscleAnalysis:
    """Analyse a recording.

    Parameters
    ----------
    pulses : PulseTrain
        Delivered pulses, in any order; an intensity of NaN is one that was not recorded.
    force : ForceTrace
        Measured force, in any order.
    progress : callable
        Called with a label, the number done and the total number.

    Raises
    ------
    IdentificationError
        If there are fewer than 100 force samples.
    """
    return _Analysis(pulses, force, progress).result()


class _Analysis:
    """One run of the analysis, with its data and findings."""

    def __init__(self, pulses: PulseTrain, force: ForceTrace, progress: Progress) -> None:
        self._progress = progress
        self.trace = clean(force)
        self.findings = list(self.trace.findings)
        shares = np.where(outside_shares(pulses.intensity), np.nan, pulses.intensity)
        # by onset, each onset once
        first = np.unique(pulses.onset_ns, return_index=True)[1]
        self.pulses = self._within(replace(pulses, intensity=shares)[first])
        self.groups = groups_of(self.pulses)

    def result(self) -> MuscleAnalysis:
        """Analyse each kind of group that the recording has."""
        artifacts = twitches = summation = recruitment = None
        steady: tuple[SteadyPoint, ...] = ()
        if len(self.pulses):
            self._judge_intensities()
            artifacts = find_artifacts(self.trace, self.pulses.onset_ns)
            self._judge_clocks(artifacts)
            onset_ns = self.pulses.onset_ns + nanoseconds(artifacts.clock_offset)
            responses = self._responses(replace(self.pulses, onset_ns=onset_ns), artifacts)
            twitches = self._twitches(responses)
            # the usual one where no twitch tells
            summation = self._trains(responses, twitches.choice.order if twitches else 3)
            steady = self._steady(onset_ns, artifacts.found)
            recruitment = self._field(steady)
        counts = Counter(group.kind for group in self.groups)
        return MuscleAnalysis(
            contents={kind.value: counts[kind] for kind in Kind if counts[kind]},
            pulses=len(self.pulses),
            samples=len(self.trace.stamp_ns),
            sample_rate_hz=1.0 / self.trace.sample_period,
            noise=self.trace.noise,
            artifacts=artifacts,
            twitches=twitches,
            summation=summation,
            steady=steady,
            recruitment=recruitment,
            findings=tuple(self.findings),
        )

    def _within(self, pulses: PulseTrain) -> PulseTrain:
        if not len(pulses):
            self.findings.append('there are no pulses: the muscle cannot be analysed')
            return pulses
        stamps = self.trace.stamp_ns
        inside = (pulses.onset_ns >= stamps[0]) & (pulses.onset_ns <= stamps[-1])
        if not inside.all():
            count, of = int((~inside).sum()), len(pulses)
            self.findings.append(
                f'{count} of {of} pulses lie outside the span of the force; they are left out'
            )
        return pulses[inside]

    def _judge_intensities(self) -> None:
        known = self.pulses.intensity[np.isfinite(self.pulses.intensity)]
        if len(known) < len(self.pulses):
            count, of = len(self.pulses) - len(known), len(self.pulses)
            self.findings.append(
                f'the intensity of {count} of {of} pulses is not recorded, or no share of the '
                'maximum: latency, twitch and summation do not need it, recruitment against '
                'intensity does'
            )
        elif np.ptp(known) < _ALIKE:
            self.findings.append(
                f'all pulses have the intensity {known[0]:.3g}: recruitment against intensity '
                'cannot be determined'
            )

    def _judge_clocks(self, artifacts: Artifacts) -> None:
        if not artifacts.found:
            self.findings.append(
                'the force shows no stimulation artifact: the stamps of the pulses are taken as '
                'the stimulus instants, and the clocks cannot be compared'
            )
        elif artifacts.clock_offset:
            self.findings.append(
                f'the clocks of sensor and stimulator differ by {artifacts.clock_offset * 1e3:.2f}'
                ' ms, as the artifacts show; the pulses are moved by that'
            )

    def _responses(self, pulses: PulseTrain, artifacts: Artifacts) -> list[Response | str]:
        """Return the response to each group, or why it is not used."""
        # a longer train only repeats itself
        short = [one._replace(last=min(one.last, one.first + MOST_PULSES)) for one in self.groups]
        responses = [cut(self.trace, pulses, artifacts, group) for group in short]
        overlapping: dict[int, str] = {}
        for index, response in enumerate(responses[:-1]):
            whole = short[index] == self.groups[index]
            if isinstance(response, Response) and whole and _share_left(response) > LEFT_OVER:
                overlapping[index] = 'not decayed when the next begins'
                overlapping[index + 1] = 'begins while the one before lasts'
        if overlapping:
            first_ns = self.pulses.onset_ns[self.groups[min(overlapping)].first]
            moment = (first_ns - self.trace.stamp_ns[0]) / NANOSECONDS_PER_SECOND
            self.findings.append(
                f'{len(overlapping)} responses overlap, the first at {moment:.2f} s: more than '
                f'{LEFT_OVER:.0%} is left when the next begins; they are not used'
            )
        return [overlapping.get(index, response) for index, response in enumerate(responses)]

    def _of(
        self, kind: Kind, responses: Sequence[Response | str]
    ) -> tuple[list[Response], Counter[str]]:
        """Return the responses to groups of a kind, and the reasons against the others."""
        pairs = zip(self.groups, responses, strict=True)
        found = [response for group, response in pairs if group.kind is kind]
        reasons = Counter(one for one in found if isinstance(one, str))
        return [one for one in found if isinstance(one, Response)], reasons

    def _twitches(self, responses: Sequence[Response | str]) -> TwitchAnalysis | None:
        singles, reasons = self._of(Kind.SINGLE, responses)
        if not singles and not reasons:
            self.findings.append(
                'there are no single pulses: latency and twitch come from trains, if there are any'
            )
            return None
        progress = partial(self._progress, 'twitches')
        found = analyze_twitches(singles, reasons, self.trace.sample_period, progress)
        if isinstance(found, str):
            self.findings.append(found)
            return None
        if len(found.fits) == 1:
            self.findings.append('there is one twitch only: no spread can be given')
        if found.choice.order != found.choice.held_out_order:
            self.findings.append(
                f'the information criterion chooses order {found.choice.order}, the error on '
                f'held-out samples order {found.choice.held_out_order}: the order is uncertain'
            )
        return found

    def _trains(self, responses: Sequence[Response | str], order: int) -> SummationAnalysis | None:
        for kind, what in (
            (Kind.MODULATED, 'change from pulse to pulse: use `rpms identify` for them'),
            (Kind.OVERLAPPING, 'begin before the train before has decayed: not used'),
        ):
            if count := sum(group.kind is kind for group in self.groups):
                self.findings.append(f'{count} group(s) of pulses {what}')
        trains, reasons = self._of(Kind.TRAIN, responses)
        if trains:
            return analyze_trains(trains, order, reasons, partial(self._progress, 'trains'))
        if reasons:
            self.findings.append(f'no response to a train qualifies ({counted_reasons(reasons)})')
        return None

    def _steady(self, onset_ns: IntArray, artifacts: bool) -> tuple[SteadyPoint, ...]:
        trace = without_artifacts(self.trace, onset_ns) if artifacts else self.trace
        baseline = resting_force(trace, self.groups, onset_ns)
        held = [
            level
            for group in self.groups
            if group.kind in (Kind.TRAIN, Kind.STAIRCASE, Kind.OVERLAPPING)
            for level in group.levels
            if level.last - level.first > 1
        ]
        if not held or baseline is None:
            return ()
        found = [steady_point(trace, onset_ns, level, baseline) for level in held]
        if reasons := Counter(item for item in found if isinstance(item, str)):
            self.findings.append(
                f'{sum(reasons.values())} of {len(held)} levels give no steady force '
                f'({counted_reasons(reasons)})'
            )
        return tuple(item for item in found if isinstance(item, SteadyPoint))

    def _field(self, steady: tuple[SteadyPoint, ...]) -> FieldAnalysis | None:
        if not steady:
            self.findings.append('there is no steady force: recruitment cannot be determined')
            return None
        lowest = RateRecruitment().lowest_rate
        # Eq. (10) was measured from there up; towards 0 Hz its rounded coefficients dominate
        chosen = [point for point in steady if point.rate_hz > lowest * (1.0 - _ALIKE)]
        try:
            found = fit_field(chosen or steady)
        except IdentificationError as error:
            self.findings.append(f'recruitment cannot be determined: {error}')
            return None
        if not found.rates_fitted:
            self.findings.append(
                'there are fewer than 3 rates: rho_f is the average of Table 3, only rho_u fitted'
            )
        return found


def _share_left(response: Response) -> float:
    """Return the force at the end of a response, relative to its peak."""
    force = response.force[response.usable] - response.baseline
    scatter = float(np.std(response.force[response.lag < 0]))
    peak = float(np.percentile(force, 98))
    # whether a response hidden by noise lasts cannot be determined
    return 0.0 if peak < 10.0 * scatter else float(np.mean(force[-20:])) / peak
