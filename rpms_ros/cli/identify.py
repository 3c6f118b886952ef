# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms identify``: recruitment and dynamics of the muscle from a recording."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

from rpms_ros.cli.files import add_signal_options
from rpms_ros.cli.options import (
    Subparsers,
    add_bag,
    add_command,
    add_estimator_options,
    add_json,
    add_option,
    add_reading_options,
    add_verdict_option,
    compile_estimator,
    options_of,
    progress,
    read,
    verdict_code,
    warn,
)
from rpms_ros.printable import printable
from rpms_ros.report.text import labelled, write_text

# More than a figure has pixels across; a minute and a half has all of its estimates.
_MOST_ESTIMATES = 1000


def add_identify(subparsers: Subparsers) -> None:
    """Add `rpms identify`."""
    text = 'recruitment and dynamics of the muscle from a recording'
    parser = add_command(subparsers, 'identify', run, text)
    add_bag(parser)
    add_json(parser)
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for figures and JSON')
    add_reading_options(parser)
    add_estimator_options(parser)
    group = parser.add_argument_group('what is known before')
    text = (
        'start from what an earlier session of the patient has told, in the JSON of this command; '
        'it gives way where it is wrong (tracking)'
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
    """Identify the recording; return the exit code of the verdict.

    Identifies recruitment and dynamics of the muscle from recorded pulses and force, with the
    estimator that also runs on line: a recording gives the estimates of the live session bit for
    bit.

    Examples
    --------
      rpms identify bags/sample
      rpms identify session --out results                  result.json and figures
      rpms identify trial.csv --force 'fGM [N]'             a file as rpms import takes it
      rpms identify session --json | jq .recruitment       one JSON object on stdout
      rpms identify session --force-topic /left/wrench --axis x --sign -1
      rpms identify session --rate-hz 15                   the curve for pulses at 15 Hz
      rpms identify session --estimator recursive          as the node does, sample by sample
      rpms identify monday --json > ada.json
      rpms identify friday --estimator tracking --start-from ada.json

    exit code: of the verdict, 0 good, 1 doubtful or a recording with faults, 3 no;
    2 if not possible
    """
    from rpms_ros.identification.model.history_law import TemporalSummation
    from rpms_ros.identification.quality.verdict import FOLLOWER
    from rpms_ros.report.result import IdentificationOptions, identified, result_of, result_rows
    from rpms_ros.schema import plain

    law = arguments.temporal_summation
    history = TemporalSummation.of_file(law) if law else None
    options = replace(options_of(IdentificationOptions, arguments), history=history)
    recording = read(arguments.bag, arguments)
    compile_estimator(options.build, arguments.quiet)
    with progress('identifying', len(recording.forces), 'samples', arguments.quiet) as advance:
        # The result is the last estimate; figures, and whether the muscle changed, need more.
        most = _MOST_ESTIMATES if arguments.out or arguments.estimator == FOLLOWER else 1
        session = identified(recording, options, advance, most)
    result = result_of(recording, session, arguments.expected_force)
    if folder := arguments.out:
        from rpms_ros.report.analysis_figures import save_figure
        from rpms_ros.report.figures import draw_session, style
        from rpms_ros.report.recorded import true_muscle

        write_text(folder / 'result.json', json.dumps(plain(result), allow_nan=False, indent=1))
        truth = true_muscle(recording, result.rate_hz)
        figure = draw_session(session, recording.pulses, truth, str(arguments.bag), result.trains)
        with style():
            save_figure(figure, folder / 'session.png', folder / 'session.svg')
    if arguments.json:
        print(json.dumps(plain(result), allow_nan=False))
    else:
        print(f'{printable(str(arguments.bag))}\n{labelled(result_rows(result))}')
    warn(('warning', text) for text in result.notes)
    return verdict_code(result.verdict.grade, recording)
