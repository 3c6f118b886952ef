# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms report``: a recording as one page that can be read, printed and sent."""

import argparse
import json
import shlex
import sys
from pathlib import Path

from rpms_ros.cli.files import add_signal_options
from rpms_ros.cli.options import (
    Subparsers,
    add_bag,
    add_command,
    add_estimator_options,
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
from rpms_ros.errors import ReportError
from rpms_ros.report.text import write_text


def add_report(subparsers: Subparsers) -> None:
    """Add `rpms report`."""
    parser = add_command(subparsers, 'report', run, 'a recording as one page')
    add_bag(parser)
    add_option(parser, '--out FILE', Path('report.html'), 'page to write', type=Path)
    add_option(parser, '--files DIR', None, 'folder for the figures and report.json', type=Path)
    text = 'also print what the page holds as one JSON object'
    parser.add_argument('--json', action='store_true', help=text)
    text = 'headline; the note "muscle" or the name of the recording if not given'
    add_option(parser, '--title TEXT', None, text)
    add_reading_options(parser)
    add_estimator_options(parser)
    add_verdict_option(parser)
    add_signal_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the report; return the exit code of the verdict.

    Identifies a recording as `rpms identify` does and writes one self-contained page: recruitment,
    impulse response, time courses, force, residual analysis, faults, schedule and energy,
    session facts.

    Examples
    --------
      rpms report bags/sample --out report.html
      rpms report session --files figures            PNG, SVG and JSON files beside the page
      rpms report session --json | jq .headline      one JSON object on stdout
    """
    from rpms_ros.recording.importing import is_foreign
    from rpms_ros.report.figures import write_figures
    from rpms_ros.report.page import as_page
    from rpms_ros.report.recorded import RecordedMessages, recorded_messages
    from rpms_ros.report.result import IdentificationOptions, identified, result_of
    from rpms_ros.report.session_report import report_of
    from rpms_ros.schema import plain

    page = arguments.out.suffix.lower() in ('.html', '.htm')
    if not page and (arguments.out.is_file() or arguments.out.suffix):
        raise ReportError(f'expected a page (.html) with --out, got a file {arguments.out}')
    options = options_of(IdentificationOptions, arguments)
    recording = read(arguments.bag, arguments)
    messages = RecordedMessages()
    if not is_foreign(arguments.bag):
        messages = recorded_messages(recording, memory=arguments.max_memory)
    noted = recording.facts.custom.get('muscle', '').strip()
    title = arguments.title or noted or arguments.bag.resolve().name
    command = shlex.join(['rpms', *sys.argv[1:]]) if sys.argv[1:2] == ['report'] else ''
    compile_estimator(options.build, arguments.quiet)
    with progress('identifying', len(recording.forces), 'samples', arguments.quiet) as advance:
        session = identified(recording, options, advance)
    result = result_of(recording, session, arguments.expected_force)
    report = report_of(title, recording, messages, session, result, command)
    document, verdict = plain(report), report.result.verdict
    write_text(arguments.out, as_page(report))
    if arguments.files:
        write_figures(arguments.files, report)
        text = json.dumps(document, allow_nan=False, indent=1)
        write_text(arguments.files / 'report.json', text)
    if arguments.json:
        print(json.dumps(document, allow_nan=False))
    else:
        print(f'verdict {verdict.line}')
        print(f'{arguments.out}: {arguments.out.stat().st_size / 1e6:.2f} MB')
    warn(('warning', text) for text in report.remarks)
    return verdict_code(verdict.grade, report.recording)
