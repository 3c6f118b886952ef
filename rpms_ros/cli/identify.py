# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms identify``: recruitment and dynamics of the muscle from a recording."""

import argparse
import json
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.axis import QUANTITIES
from rpms_ros.cli.import_file import add_signal_options
from rpms_ros.cli.options import (
    add_bag,
    add_command,
    add_estimator_options,
    add_option,
    add_reading_options,
    add_verdict_option,
    compile_estimator,
    identification_options,
    progress,
    read,
    verdict_code,
    verdict_settings,
    warn,
)
from rpms_ros.printable import counted, printable
from rpms_ros.report.text import (
    label,
    labelled,
    recruitment_shown,
    shown,
    with_interval,
    write_text,
)

if TYPE_CHECKING:
    from rpms_ros.identification import IdentifiedSession
    from rpms_ros.identification.analysis.dynamics import TrainDynamics
    from rpms_ros.recording import Recording
    from rpms_ros.report.result import IdentificationResult

_DESCRIPTION = """\
Identifies recruitment and dynamics of the muscle from recorded pulses and force, with the
estimator that also runs on line: a recording gives the estimates of the live session bit for bit.
"""
_EXAMPLES = """\
  rpms identify bags/sample
  rpms identify session --out results                  result.json and figures
  rpms identify trial.csv --force 'fGM [N]'             a file as rpms import takes it
  rpms identify session --json | jq .recruitment       one JSON object on stdout
  rpms identify session --force-topic /left/wrench --axis x --sign -1
  rpms identify session --rate-hz 15                   the curve for pulses at 15 Hz
  rpms identify session --estimator recursive          as the node does, sample by sample
  rpms identify monday --estimator tracking --save-state ada.state
  rpms identify friday --estimator tracking --start-from ada.state

exit code: of the verdict, 0 good, 1 doubtful or a recording with faults, 3 no; 2 if not possible
"""
_CURVE_SHOWN = (0.25, 0.5, 0.75, 1.0)
# More than a figure has pixels across; a minute and a half has all of its estimates.
_MOST_ESTIMATES = 1000


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    text = 'recruitment and dynamics of the muscle from a recording'
    parser = add_command(subparsers, 'identify', run, text, _DESCRIPTION, _EXAMPLES)
    add_bag(parser)
    text = 'one JSON object on stdout and nothing else there'
    parser.add_argument('--json', action='store_true', help=text)
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for figures and JSON')
    add_reading_options(parser)
    add_estimator_options(parser)
    group = parser.add_argument_group('what is known before and after')
    text = 'file for what is known at the end: the node and --start-from read it'
    add_option(group, '--save-state FILE', None, text, type=Path)
    text = (
        'start from what an earlier session of the patient has told, a saved state or the JSON of '
        'this command; it gives way where it is wrong (tracking)'
    )
    add_option(group, '--start-from FILE', None, text, type=Path)
    text = (
        'weigh each pulse by the pulses before it, with the history law in the JSON of rpms '
        'analyze or a JSON object of its numbers; for trains of 30 Hz and more (batch, '
        'tracking)'
    )
    add_option(group, '--temporal-summation FILE', None, text, type=Path)
    add_verdict_option(parser)
    add_signal_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Identify the recording; return the exit code of the verdict."""
    from rpms_ros.identification.model.summation import TemporalSummation
    from rpms_ros.identification.quality.stationarity import FOLLOWER
    from rpms_ros.report.result import identified, result_of
    from rpms_ros.schema import plain

    law = arguments.temporal_summation
    options = replace(
        identification_options(arguments),
        history=TemporalSummation.of_file(law) if law else None,
        start_from=arguments.start_from,
        save_state=arguments.save_state,
    )
    recording = read(arguments.bag, arguments)
    samples = len(recording.forces)
    compile_estimator(options.build, arguments.quiet)
    with progress('identifying', samples, 'samples', arguments.quiet) as advance:
        # Figures show a path of estimates; the result is the last one.
        # A state that is gone on with on line is made with the period on line.
        # So does the answer to the question whether the muscle changed.
        few = _MOST_ESTIMATES if arguments.out or arguments.estimator == FOLLOWER else 1
        most = None if arguments.save_state else few
        session = identified(recording, options, advance, most)
    result = result_of(recording, session, verdict_settings(arguments))
    if arguments.json:
        print(json.dumps(plain(result), allow_nan=False))
    else:
        print(f'{printable(str(arguments.bag))}\n{as_text(result)}')
    warn(('warning', text) for text in result.notes)
    if arguments.out:
        _write(arguments.out, result, recording, session, str(arguments.bag))
    return verdict_code(result.verdict.grade, recording)


def as_text(result: 'IdentificationResult') -> str:
    """Return the result as a short table, the verdict first."""
    from rpms_ros.report.result import FOLLOWED

    first, *others = result.verdict.reasons
    counts = f'{counted(result.samples, "sample")}, {counted(result.pulses, "pulse")}'
    rows = [
        ('verdict', f'{result.verdict.grade}: {first}'),
        *(('', reason) for reason in others),
        ('estimator', FOLLOWED if FOLLOWED in result.notes else result.estimator),
        ('data', f'{counts}, {result.duration_s:.3f} s'),
        ('session hash', result.session_hash),
        *(('schedule', f'{one.name}, sha256 {one.sha256}') for one in result.schedules),
    ]
    # What must not be used is not there to be copied.
    if result.verdict.grade != 'no':
        rows += _found(result)
        if result.steadiness is not None:
            rows.append(('the muscle', result.steadiness))
    if result.dynamics is None:
        rows.append(('prediction error', _output_error(result)))
    faults = (f'{name} {count}' for name, count in result.faults.items())
    rows.append(('faults', ', '.join(faults) or 'none'))
    return labelled(rows)


def _found(result: 'IdentificationResult') -> list[tuple[str, str]]:
    """Return the rows of what was identified; nothing that the data do not tell."""
    from rpms_ros.report.result import NOT_A_TWITCH

    unit, curve, rows = result.unit, result.curve, []
    if curve is None:
        rows.append(('recruitment', 'cannot be told from one intensity'))
    else:
        flags, deviations = result.identifiability or {}, result.deviation or {}
        for name, value in (result.recruitment or {}).items():
            known = (deviations.get(name), result.confidence, flags.get(name))
            rows.append((label(name), recruitment_shown(name, value, *known)))
        what = f'steady {QUANTITIES[unit]} at {result.rate_hz:g} Hz'
        for share in _CURVE_SHOWN:
            force = with_interval(vars(curve.at(share)), unit=f' {unit}')
            rows.append((what, f'{force} at intensity {share:g}'))
            what = ''
    if result.dynamics is not None:
        return rows + _dynamics(result.dynamics, unit)
    for name, stated in (result.physiology or {}).items():
        rows.append((label(name), shown(name, vars(stated), unit)))
    response = result.impulse_response
    peak = with_interval(vars(response.peak), unit=f' {unit}')
    after = f'{1e3 * response.peak_time_s:.0f} ms'
    rows.append(('response to one pulse', f'peak {peak} after {after}'))
    return [*rows, ('', NOT_A_TWITCH)] if result.is_no_twitch else rows


def _dynamics(found: 'TrainDynamics', unit: str) -> list[tuple[str, str]]:
    """Return the rows of trains of one intensity."""
    onset, model = found.onset_s, found.model
    trains = f'{found.trains} of {found.pulses} pulses at {found.rate_hz:.4g} Hz'
    fits = {
        model: found.fit_percent,
        'equal pulses': found.fit_equal_percent,
        'a gain a pulse': found.fit_gains_percent,
    }
    fit = ', '.join(f'{name} {percent:.1f} %' for name, percent in fits.items())
    constant = _milliseconds(found.twitch_time_constant_s)
    rows = [
        ('trains', f'{trains}, peak {found.peak_force:.4g} {unit}'),
        (f'onset of {QUANTITIES[unit]}', _milliseconds(onset) if onset else 'hidden by noise'),
        (f'T_a, {model}', f'{constant}, order {found.order}'),
        (f'delay of the model, {model}', _milliseconds(found.latency_s)),
        ('fit', f'{fit} (100 (1 - |residual| / |force - mean|))'),
    ]
    if found.law:
        numbers = (f'{name} {value:.3g}' for name, value in vars(found.law).items())
        rows.append(('history law', '  '.join(numbers)))
    return rows


def _milliseconds(found: object) -> str:
    return with_interval(vars(found), 1e3, ' ms')


def _output_error(result: 'IdentificationResult') -> str:
    """Return the output error in words."""
    what, of_range = QUANTITIES[result.unit], result.output_error_of_range
    if not isfinite(result.output_error_n):
        return 'unknown: no usable sample was predicted before it was learnt'
    share = f'{100 * of_range:.3g} % of the range of the {what}'
    share = share if isfinite(of_range) else f'no {what}'
    return (
        f'{result.output_error_n:.3g} {result.unit}, {share} (root mean square after settling, '
        'each sample predicted before it was learnt)'
    )


def _write(
    folder: Path,
    result: 'IdentificationResult',
    recording: 'Recording',
    session: 'IdentifiedSession',
    title: str,
) -> None:
    """Write the result and its figure, as pixels and as vectors."""
    from rpms_ros.report.figures import draw_session
    from rpms_ros.report.recorded import true_muscle
    from rpms_ros.report.result import trains_of
    from rpms_ros.schema import plain

    truth, trains = true_muscle(recording, result.rate_hz), trains_of(recording, result)
    write_text(folder / 'result.json', json.dumps(plain(result), allow_nan=False, indent=1))
    paths = (folder / 'session.png', folder / 'session.svg')
    draw_session(paths, session, recording.pulses, truth, title, trains)
