# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms study``: many recordings, one table."""

import argparse
from collections import Counter
from pathlib import Path

from rpms_ros.cli.options import (
    Subparsers,
    add_command,
    add_estimator_options,
    add_option,
    add_reading_options,
    add_verdict_option,
    compile_estimator,
    options_of,
    progress,
    warn,
)
from rpms_ros.printable import counted


def add_study(subparsers: Subparsers) -> None:
    """Add `rpms study`."""
    text = 'many recordings, one table'
    parser = add_command(subparsers, 'study', run, text)
    text = 'recordings, or folders of recordings'
    parser.add_argument('bags', type=Path, nargs='+', metavar='BAG', help=text)
    parser.add_argument('--out', type=Path, required=True, metavar='DIR', help='of the table')
    add_option(parser, '--jobs N', None, 'processes (default: one a processor)', type=int)
    add_reading_options(parser)
    add_estimator_options(parser)
    add_verdict_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Identify what has not been identified yet, and write the table.

    Identifies many recordings and writes one table, results.csv and results.json, with a row for
    each: what was found and the verdict, or why it failed.  A study that was interrupted goes on
    where it stopped; what failed is tried again.  The table does not depend on the number of
    processes.

    Examples
    --------
      rpms study sessions/* --out study
      rpms study sessions --out study --jobs 8          every recording below the folder
    exit codes: 0 all well, 1 a recording failed, had faults or has a verdict that is not good,
    2 not possible
    """
    from rpms_ros.errors import RecordingError
    from rpms_ros.identification.quality.verdict import GRADES
    from rpms_ros.report.study import StudyOptions, StudyTable, finished, found_recordings

    options = options_of(StudyOptions, arguments)
    # options that no recording can be identified with are told once, not with each of them
    options.build()
    recordings = found_recordings(arguments.bags, arguments.out)
    if not recordings:
        places = ', '.join(map(str, arguments.bags))
        raise RecordingError(f'expected recordings or folders of recordings, got none in {places}')
    table = StudyTable(arguments.out, recordings, options)
    waiting = table.waiting()
    if waiting:
        compile_estimator(options.build, arguments.quiet)
    with progress('identifying', len(waiting), 'recordings', arguments.quiet) as advance:
        try:
            for path, row in finished(waiting, options, arguments.jobs):
                table.add(path, row)
                advance(1)
        finally:
            table.write()
    rows = table.rows()
    failed = [row for row in rows if row['status'] != 'ok']
    warn(('warning', remark) for remark in table.remarks())
    warn((row['recording'], row['reason']) for row in failed)
    doubted = [row for row in rows if row['verdict'] not in (None, 'good')]
    warn((row['recording'], f'{row["verdict"]}: {row["reasons"]}') for row in doubted)
    done = len(rows) - len(waiting)
    counts = Counter(row['verdict'] for row in rows)
    grades = ', '.join(f'{counts[grade]} {grade}' for grade in GRADES if counts[grade])
    print(
        f'{arguments.out}: {counted(len(rows), "recording")}, {len(failed)} failed, '
        f'{done} done before' + (f'; verdicts: {grades}' if grades else '')
    )
    return 1 if failed or doubted or any(row['faults'] != '{}' for row in rows) else 0
