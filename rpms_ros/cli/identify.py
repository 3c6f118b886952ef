# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms identify``: recruitment and dynamics of the muscle from a recording."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.axis import QUANTITIES
from rpms_ros.cli.import_file import add_signal_options
from rpms_ros.cli.options import (
    INCOMPLETE,
    SUCCESS,
    UNUSABLE,
    add_bag,
    add_command,
    add_option,
    add_quantity_option,
    add_reading_options,
    compile_estimator,
    progress,
    read,
    warn,
)
from rpms_ros.errors import ReportError
from rpms_ros.printable import counted, printable
from rpms_ros.report.text import (
    NOT_A_TWITCH,
    is_no_twitch,
    label,
    labelled,
    recruitment_shown,
    shown,
    with_interval,
)

if TYPE_CHECKING:
    from rpms_ros.identification import IdentifiedSession
    from rpms_ros.identification.analysis import SummationAnalysis
    from rpms_ros.recording import Recording

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
  rpms identify monday --estimator horizon --save-state ada.state
  rpms identify friday --estimator horizon --start-from ada.state

exit code: of the verdict, 0 good, 1 doubtful or a recording with faults, 3 no; 2 if not possible
"""
# Those of `rpms_ros.identification.PRESET_NAMES`, which takes long to import.
PRESETS = ('people', 'paper_table_4', 'paper_table_5')
_CURVE_SHOWN = (0.25, 0.5, 0.75, 1.0)
# More than a figure has pixels across; a minute and a half has all of its estimates.
_MOST_ESTIMATES = 1000


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers,
        'identify',
        run,
        'recruitment and dynamics of the muscle from a recording',
        _DESCRIPTION,
        _EXAMPLES,
    )
    add_bag(parser)
    parser.add_argument(
        '--json', action='store_true', help='one JSON object on stdout and nothing else there'
    )
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for figures and JSON')
    add_reading_options(parser)
    add_quantity_option(parser)
    add_estimator_options(parser)
    _add_state_options(parser)
    add_verdict_option(parser)
    add_signal_options(parser)


def add_verdict_option(parser: argparse.ArgumentParser) -> None:
    """Add what the verdict takes for granted."""
    text = 'force that this muscle can have at most [N]; more is taken for a wrong unit'
    add_option(parser, '--expected-force N', 200.0, text)


def verdict_code(grade: str, faults: bool) -> int:
    """Return the exit code of a verdict on a recording with or without faults."""
    if grade == 'no':
        return UNUSABLE
    return INCOMPLETE if faults or grade != 'good' else SUCCESS


def _add_state_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('what is known before and after')
    text = 'file for what is known at the end: the node and --start-from read it'
    group.add_argument('--save-state', type=Path, metavar='FILE', help=text)
    text = (
        'start from what an earlier session of the patient has told, a saved state or the JSON of '
        'this command; it gives way where it is wrong (horizon, tracking)'
    )
    group.add_argument('--start-from', type=Path, metavar='FILE', help=text)
    text = (
        'weigh each pulse by the pulses before it, with the history law in the JSON of rpms '
        'analyze or a JSON object of its numbers; for trains of 30 Hz and more (batch, horizon, '
        'tracking)'
    )
    group.add_argument('--temporal-summation', type=Path, metavar='FILE', help=text)


def add_estimator_options(parser: argparse.ArgumentParser, on_line: bool = False) -> None:
    """Add the options of the estimator."""
    group = parser.add_argument_group('estimator')
    add_option(
        group,
        '--estimator NAME',
        'recursive' if on_line else 'batch',
        'algorithm: batch (everything at once), or as on line horizon (the last 20 s), tracking '
        '(a muscle that changes) or recursive (one pass, as the node by default)',
    )
    add_preset_option(group)
    text = 'repetition rate for which the recruitment curve is stated [Hz]'
    add_option(group, '--rate-hz HZ', 20.0, text)
    if not on_line:
        add_option(group, '--seed', 0, "of the estimator's random start")


def add_preset_option(parser: 'argparse._ActionsContainer') -> None:
    """Add the choice of what the paper printed."""
    text = (
        'paper_table_4 or paper_table_5 reproduce those tables of the paper and are not for '
        'people; leave it out otherwise, and with tracking'
    )
    add_option(parser, '--preset', 'people', text, choices=PRESETS)


def run(arguments: argparse.Namespace) -> int:
    """Identify the recording; return the exit code of the verdict."""
    from rpms_ros.identification.quality.stationarity import FOLLOWER
    from rpms_ros.identification.quality.verdict import VerdictSettings
    from rpms_ros.report.result import (
        IdentificationOptions,
        history_of,
        identified,
        result_of,
        trains_of,
    )
    from rpms_ros.schema import plain

    settings = VerdictSettings(expected_force=arguments.expected_force)
    options = IdentificationOptions(
        arguments.estimator,
        arguments.preset,
        arguments.rate_hz,
        arguments.seed,
        history_of(arguments.temporal_summation),
        arguments.start_from,
        arguments.save_state,
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
    result = result_of(recording, session, settings)
    document = plain(result)
    if arguments.json:
        print(json.dumps(document, allow_nan=False))
    else:
        print(f'{printable(str(arguments.bag))}\n{as_text(document)}')
    warn(('warning', text) for text in document['notes'])
    if arguments.out:
        trains = trains_of(recording, result)
        _write(arguments.out, document, recording, session, str(arguments.bag), trains)
    return verdict_code(document['verdict']['grade'], bool(recording.facts.faults))


def as_text(document: dict[str, Any]) -> str:
    """Return the result as a short table, the verdict first."""
    from rpms_ros.report.result import FOLLOWED

    verdict, duration = document['verdict'], document['duration_s']
    first, *others = verdict['reasons']
    rows = [
        ('verdict', f'{verdict["grade"]}: {first}'),
        *(('', reason) for reason in others),
        ('estimator', FOLLOWED if FOLLOWED in document['notes'] else document['estimator']),
        ('data', f'{_counts(document)}, {duration:.3f} s'),
        ('session hash', document['session_hash']),
        *(('schedule', f'{one["name"]}, sha256 {one["sha256"]}') for one in document['schedules']),
    ]
    # What must not be used is not there to be copied.
    if verdict['grade'] != 'no':
        rows += _found(document)
    if verdict['grade'] != 'no' and 'steadiness' in document:
        rows.append(('the muscle', document['steadiness']))
    if 'dynamics' not in document:
        rows.append(('prediction error', _output_error(document)))
    faults = (f'{name} {count}' for name, count in document['faults'].items())
    rows.append(('faults', ', '.join(faults) or 'none'))
    return labelled(rows)


def _counts(document: dict[str, Any]) -> str:
    samples, pulses = document['samples'], document['pulses']
    return f'{counted(samples, "sample")}, {counted(pulses, "pulse")}'


def _found(document: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of what was identified; nothing that the data do not tell."""
    rows = []
    unit = document['unit']
    what = QUANTITIES[unit]
    if document['curve']:
        flags, deviations = document.get('identifiability', {}), document.get('deviation', {})
        for name, value in document['recruitment'].items():
            known = (deviations.get(name), document.get('confidence'), flags.get(name))
            rows.append((label(name), recruitment_shown(name, value, *known)))
        rows += [
            (
                '' if index else f'steady {what} at {document["rate_hz"]:g} Hz',
                f'{_at(document["curve"], share, unit)} at intensity {share:g}',
            )
            for index, share in enumerate(_CURVE_SHOWN)
        ]
    else:
        rows.append(('recruitment', 'cannot be told from one intensity'))
    if 'dynamics' in document:
        return rows + _dynamics(document['dynamics'], unit)
    for name, found in document.get('physiology', {}).items():
        rows.append((label(name), shown(name, found, unit)))
    response = document['impulse_response']
    place = response['force'].index(max(response['force']))
    time_ms = 1e3 * response['time_s'][place]
    peak = with_interval(_place(response, place), unit=f' {unit}')
    rows.append(('response to one pulse', f'peak {peak} after {time_ms:.0f} ms'))
    if is_no_twitch(document):
        rows.append(('', NOT_A_TWITCH))
    return rows


def _dynamics(found: dict[str, Any], unit: str) -> list[tuple[str, str]]:
    """Return the rows of trains of one intensity."""
    count, onset = found['trains'], found['onset_s']
    rows = [
        (
            'trains',
            (
                f'{count} of {found["pulses"]} pulses at {found["rate_hz"]:.4g} Hz, '
                f'peak {found["peak_force"]:.4g} {unit}'
            ),
        ),
        (f'onset of {QUANTITIES[unit]}', _milliseconds(onset) if onset else 'hidden by noise'),
        (
            f'T_a, {found["model"]}',
            f'{_milliseconds(found["twitch_time_constant_s"])}, order {found["order"]}',
        ),
        (f'delay of the model, {found["model"]}', _milliseconds(found['latency_s'])),
        ('fit', f'{_fits(found)} (100 (1 - |residual| / |force - mean|))'),
    ]
    if found['law']:
        numbers = (f'{name} {value:.3g}' for name, value in found['law'].items())
        rows.append(('history law', '  '.join(numbers)))
    return rows


def _fits(found: dict[str, Any]) -> str:
    """Return how well each model fits the trains, the one that is stated first."""
    fits = {
        found['model']: found['fit_percent'],
        'equal pulses': found['fit_equal_percent'],
        'a gain a pulse': found['fit_gains_percent'],
    }
    return ', '.join(f'{model} {percent:.1f} %' for model, percent in fits.items())


def _milliseconds(found: dict[str, float | None]) -> str:
    return with_interval(found, 1e3, ' ms')


def _output_error(document: dict[str, Any]) -> str:
    """Return the output error in words."""
    newton, of_range = document['output_error_n'], document['output_error_of_range']
    if newton is None:
        return 'unknown: no usable sample was predicted before it was learnt'
    what = QUANTITIES[document['unit']]
    share = (
        f'no {what}' if of_range is None else f'{100 * of_range:.3g} % of the range of the {what}'
    )
    return (
        f'{newton:.3g} {document["unit"]}, {share} (root mean square after settling, each sample '
        'predicted before it was learnt)'
    )


def _at(curve: dict[str, list[float]], share: float, unit: str) -> str:
    """Return the force at an intensity, with its interval if there is one."""
    return with_interval(_place(curve, round(share * (len(curve['force']) - 1))), unit=f' {unit}')


def _place(curve: dict[str, list[float]], place: int) -> dict[str, float | None]:
    """Return a point of a curve with the ends of its interval if there are any."""
    names = {'value': 'force', 'lower': 'lower', 'upper': 'upper'}
    return {end: curve[name][place] if name in curve else None for end, name in names.items()}


def _write(
    folder: Path,
    document: dict[str, Any],
    recording: 'Recording',
    session: 'IdentifiedSession',
    title: str,
    trains: 'SummationAnalysis | None',
) -> None:
    """Write the result and its figure, as pixels and as vectors."""
    from rpms_ros.report.recorded import true_muscle
    from rpms_ros.report.session.session_figure import draw_session

    truth = true_muscle(recording, session.last.repetition_rate)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'result.json').write_text(json.dumps(document, allow_nan=False, indent=1))
    except OSError as error:
        raise ReportError(f'expected to write into {folder}, got {error}') from error
    paths = (folder / 'session.png', folder / 'session.svg')
    draw_session(paths, session, recording.pulses, truth, title, trains)
