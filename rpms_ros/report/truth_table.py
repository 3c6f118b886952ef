# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""True against identified at the end of a session, as a table of text."""

import textwrap

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import IdentifiedSession
from rpms_ros.report.course import course_of
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.text import table


def truth_table(session: IdentifiedSession, truth: KnownMuscle) -> str:
    """Return a table of the true and the identified parameters of the muscle at the end.

    Parameters
    ----------
    session : IdentifiedSession
        A session with this muscle.
    truth : KnownMuscle
        The muscle.
    """
    last = session.last
    rows = [('at the end', 'true', 'identified')]
    now = np.array([last.stamp_ns])
    for name, value in zip(last.nonlinear_names, last.nonlinear, strict=True):
        true = truth.parameter(name, now)
        rows.append((name, _number(None if true is None else float(true[0])), _number(value)))
    time = last.response_time
    response = truth.response(time, last.stamp_ns)
    if response is not None:
        for label, one, found in (
            (f'peak of one twitch / {last.unit}', response.max(), last.response_force.max()),
            ('at / ms', 1e3 * time[response.argmax()], 1e3 * time[last.response_force.argmax()]),
        ):
            rows.append((label, _number(float(one)), _number(float(found))))
    if truth.comparable(last):
        steady = float(truth.full_force(now)[0])
        rate = f'steady {QUANTITIES[last.unit]} at {last.repetition_rate:g} Hz / {last.unit}'
        rows.append((rate, _number(steady), _number(float(last.curve_force[-1]))))
    rows.append(('worst error of the curve', '', f'{100 * truth.error(last):.2f} %'))
    judged = truth.judged(course_of(session))
    if judged is not None and judged.worst_at_s > 0.0:
        label = f'worst from {judged.since_s:.0f} s on, at {judged.worst_at_s:.0f} s'
        rows.append((label, '', f'{100 * judged.worst_error:.2f} %'))
    error = session.output_error
    rows.append((f'output error after settling / {last.unit}', '', _number(error.newton)))
    rows.append(('share of the force range', '', f'{100 * error.of_range:.2f} %'))
    return textwrap.indent(table(rows[0], rows[1:]), '  ')


def _number(value: float | None) -> str:
    return '' if value is None else f'{value:.4g}'
