# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms analyze``: latency, twitch, summation and recruitment from recordings."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rpms_ros.cli.files import add_signal_options
from rpms_ros.cli.options import Subparsers, add_command, add_reading_options, progress, read, warn
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain
from rpms_ros.report.text import write_text

Session = tuple[PulseTrain, ForceTrace]
# Between trials; and the rest before the first pulse of each, above which its forces are.
_PAUSE_NS, _REST_NS = 10 * NANOSECONDS_PER_SECOND, 200_000_000


def add_analyze(subparsers: Subparsers) -> None:
    """Add `rpms analyze`."""
    text = 'latency, twitch, summation and recruitment from a recording'
    parser = add_command(subparsers, 'analyze', run, text)
    text = 'folder or file of a recording'
    parser.add_argument('bags', type=Path, nargs='+', metavar='BAG', help=text)
    text = 'one JSON object on stdout and nothing else there; a list for several recordings'
    parser.add_argument('--json', action='store_true', help=text)
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for figures and JSON')
    text = 'ignore the intensities in the recording, as after importing a gate'
    parser.add_argument('--unknown-intensity', action='store_true', help=text)
    text = 'the recordings are parts of one session: put them one after another in time'
    parser.add_argument('--together', action='store_true', help=text)
    add_reading_options(parser)
    add_signal_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Analyse the recordings; return 1 if one is faulty or nothing was found in it.

    Characterises a muscle: latency, twitch and its order from single pulses, summation and history
    from trains, the recruitment field from staircases. Sorts the pulses of a recording into these,
    analyses each kind, and reports what could not be analysed and why.

    Examples
    --------
      rpms protocol muscle --out muscle.yaml
      rpms simulate --out session --schedule muscle.yaml --subject rpms --noise 0.04 --artifact 4
      rpms analyze session
      rpms analyze session --out results            result.json and figures
      rpms analyze session --json | jq .twitches.choice.order
      rpms analyze magnetic electrical              two recordings, one after the other
      rpms analyze --together trial_1 trial_2       parts of one session, analysed as one
    """
    from rpms_ros.identification.analysis import analyze
    from rpms_ros.report.analysis_report import analysis_document, analysis_text

    recordings = [read(bag, arguments) for bag in arguments.bags]
    names = [bag.name for bag in arguments.bags]
    sessions = [(recording.pulses, recording.forces) for recording in recordings]
    if arguments.together:
        if len(units := {one.unit for one in recordings}) > 1:
            raise RecordingError(f'expected one quantity, got {" and ".join(sorted(units))}')
        sessions, names = [_joined(sessions)], [f'{names[0]} to {names[-1]}']
    if arguments.unknown_intensity:
        sessions = [(replace(one, intensity=math.nan * one.intensity), f) for one, f in sessions]
    with progress('analysing', None, 'responses', arguments.quiet) as advance:
        found = [analyze(*session, progress=lambda *_: advance(1)) for session in sessions]
    # of several recordings together there is one
    pairs = zip(found, recordings, strict=not arguments.together)
    analyses = [replace(one, unit=recording.unit) for one, recording in pairs]
    documents = [analysis_document(analysis) for analysis in analyses]
    if arguments.json:
        print(json.dumps(documents if len(documents) > 1 else documents[0], allow_nan=False))
    else:
        print(analysis_text(analyses, names))
    warn(('warning', text) for recording in recordings for text in recording.facts.remarks)
    named = zip(names, analyses, strict=True)
    warn((name, finding) for name, one in named for finding in one.findings)
    if arguments.out:
        from rpms_ros.report.analysis_figures import draw_analysis

        for index, name in enumerate(names):
            place = arguments.out / f'{index + 1}-{name}' if len(names) > 1 else arguments.out
            text = json.dumps(documents[index], allow_nan=False, indent=2)
            write_text(place / 'result.json', f'{text}\n')
            drawn = draw_analysis(place, analyses[index], name)
            written = ', '.join(['result.json', *(path.name for path in drawn)])
            print(f'{place}: {written}', file=sys.stderr)
    nothing = any(not (one.twitches or one.summation or one.recruitment) for one in analyses)
    return int(nothing or any(recording.facts.faults for recording in recordings))


def _joined(sessions: Sequence[Session]) -> Session:
    """Return the sessions as one, each after the other with a pause between."""
    import numpy as np

    trains, stamp_ns, force, start = [], [], [], 0
    for pulses, forces in sessions:
        stamps = np.concatenate((forces.stamp_ns, pulses.onset_ns))
        shift = start - int(stamps.min(initial=start))
        trains.append(replace(pulses, onset_ns=pulses.onset_ns + shift))
        stamp_ns.append(forces.stamp_ns + shift)
        # steady forces are above a line from rest to rest: a sensor is zeroed between trials
        before = forces.stamp_ns - int(pulses.onset_ns.min(initial=2**62))
        rest = forces.force[(before < 0) & (before >= -_REST_NS) & np.isfinite(forces.force)]
        force.append(forces.force - (np.median(rest) if len(rest) else 0.0))
        start = int(stamps.max(initial=start - shift)) + shift + _PAUSE_NS
    return PulseTrain.joined(trains), ForceTrace(np.concatenate(stamp_ns), np.concatenate(force))
