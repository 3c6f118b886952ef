"""True against identified, as a table of text."""

import textwrap

import numpy as np

from rpms_ros.identification import IdentifiedSession
from rpms_ros.muscle import Subject
from rpms_ros.muscle import twitch
from rpms_ros.report.agreement import curve_error
from rpms_ros.report.agreement import true_parameters
from rpms_ros.report.text import table


def truth_table(session: IdentifiedSession, subject: Subject) -> str:
    """Return a table of the true and the identified parameters of the muscle.

    Parameters
    ----------
    session : IdentifiedSession
        A session with this muscle.
    subject : Subject
        The muscle.
    """
    last = session.last
    rows = [('', 'true', 'identified')]
    truth = true_parameters(subject)
    for name, value in zip(last.nonlinear_names, last.nonlinear, strict=True):
        rows.append((name, _number(truth.get(name)), _number(value)))
    time = last.response_time
    weight = subject.pulse_weight(1.0, last.repetition_rate)
    response = weight * twitch(time - subject.latency, subject.time_constant, subject.order)
    for label, true, found in (
        ('peak of one twitch / N', response.max(), last.response_force.max()),
        ('at / ms', 1e3 * time[np.argmax(response)], 1e3 * time[last.response_force.argmax()]),
    ):
        rows.append((label, _number(float(true)), _number(float(found))))
    if last.curve_known:
        steady = float(subject.steady_force(1.0, last.repetition_rate))
        rate = f'steady force at {last.repetition_rate:g} Hz / N'
        rows.append((rate, _number(steady), _number(float(last.curve_force[-1]))))
    rows.append(('worst error of the curve', '', f'{100 * curve_error(last, subject):.2f} %'))
    error = session.output_error
    rows.append(('output error after settling / N', '', _number(error.newton)))
    rows.append(('share of the force range', '', f'{100 * error.of_range:.2f} %'))
    return textwrap.indent(table(rows[0], rows[1:]), '  ')


def _number(value: float | None) -> str:
    return '' if value is None else f'{value:.4g}'
