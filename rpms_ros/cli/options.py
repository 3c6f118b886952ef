# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share."""

import argparse
import inspect
import math
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_type_hints

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable

if TYPE_CHECKING:
    from rpms_ros.identification import Estimator
    from rpms_ros.recording import Recording

Options = TypeVar('Options')
Subparsers: TypeAlias = 'argparse._SubParsersAction[argparse.ArgumentParser]'
# Those of `rpms_ros.identification.PRESET_NAMES`, which takes long to import.
PRESETS = ('people', 'arctan', 'paper_table_4', 'paper_table_5')
SUCCESS, INCOMPLETE, FAILURE, UNUSABLE, INTERRUPTED, CLOSED = 0, 1, 2, 3, 130, 141
COMPILING = 'compiling for this machine, once; this takes one to three minutes'
# What takes longer shows a bar [s].
_PATIENCE = 1.0


def add_command(
    subparsers: Subparsers, name: str, run: Callable[[argparse.Namespace], int], summary: str
) -> argparse.ArgumentParser:
    """Return the parser of a command with help and ``--quiet``.

    What it does and its examples are told by the docstring of `run`, below its first line.
    """
    description, _, examples = (inspect.getdoc(run) or '').partition('\n\nExamples\n--------\n')
    parser = subparsers.add_parser(
        name,
        help=summary,
        description=description.partition('\n\n')[2],
        epilog=f'examples:\n{examples}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--quiet', action='store_true', help='no progress bars')
    parser.set_defaults(run=run)
    return parser


def add_option(
    group: 'argparse._ActionsContainer', option: str, default: Any, text: str, **more: Any
) -> None:
    """Add an option, ``--name METAVAR``, of the type of its default, which ends its help."""
    name, _, metavar = option.partition(' ')
    if metavar:
        more['metavar'] = metavar
    shown = f'{default:g}' if isinstance(default, float) else default
    text += '' if default in (None, '', []) else f' (default: {shown})'
    more.setdefault('type', str if default is None else type(default))
    group.add_argument(name, default=default, help=text, **more)


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the recording that a command reads."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder or file of the recording')


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the choice of JSON in place of text."""
    text = 'one JSON object on stdout and nothing else there'
    parser.add_argument('--json', action='store_true', help=text)


def add_memory_option(parser: argparse.ArgumentParser) -> None:
    """Add the bound on what reading may take."""
    text = 'memory that reading the recording may take (default: 1 GB and four times its size)'
    add_option(parser, '--max-memory GB', None, text, type=_bytes_of_gigabytes)


def _bytes_of_gigabytes(text: str) -> int:
    return int(_positive(text, 'GB') * 1e9)


def _positive(text: str, unit: str = 'N') -> float:
    """Return a number above 0."""
    with suppress(ValueError):
        if 1e-9 <= (value := float(text)) < math.inf:
            return value
    raise argparse.ArgumentTypeError(f'expected a number of {unit} above 0, got {text!r}')


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Add what says where pulses and force are found in a recording."""
    group = parser.add_argument_group('where the data are')
    text = (
        'topic of delivered pulses, rpms_msgs/Pulse; without a leading slash also in a namespace'
    )
    add_option(group, '--pulses-topic NAME', 'pulses', text)
    text = 'topic of the force: WrenchStamped, Wrench or Float64'
    add_option(group, '--force-topic NAME', 'force', text)
    add_memory_option(parser)
    group = parser.add_argument_group('what the force is')
    text = '-1 if the sensor shows the pull of the muscle as negative'
    add_option(group, '--sign', 1, text, choices=(1, -1))
    add_sensor_options(group)


def add_sensor_options(group: 'argparse._ActionsContainer') -> None:
    """Add what is read of a wrench."""
    text = (
        'axis of the wrench along which the muscle pulls: x, y, z, -x or a direction as '
        '0.6,0,0.8; write --axis=-z, with the sign of equality before a minus'
    )
    add_option(group, '--axis AXIS', 'z', text)
    text = (
        'what the sensor measures; of an isometric dynamometer the torque of the wrench is read '
        'instead of its force, and everything is in N m'
    )
    add_option(group, '--quantity', 'force', text, choices=('force', 'torque'))


def add_estimator_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the estimator."""
    group = parser.add_argument_group('estimator')
    text = (
        'algorithm: batch (everything at once), or as on line tracking (a muscle that '
        'changes) or recursive (one pass, as the node by default)'
    )
    add_option(group, '--estimator NAME', 'batch', text)
    add_preset_option(group)
    text = 'repetition rate for which the recruitment curve is stated [Hz]'
    add_option(group, '--rate-hz HZ', 20.0, text)
    add_option(group, '--seed', 0, 'of the random start that presets of the paper have')


def add_preset_option(parser: 'argparse._ActionsContainer') -> None:
    """Add the choice of the model: for people, or as the paper printed it."""
    text = (
        'arctan takes the arctangents of the paper alone as recruitment; paper_table_4 and '
        'paper_table_5 reproduce its tables and are not for people; leave it out otherwise'
    )
    add_option(parser, '--preset', 'people', text, choices=PRESETS)
    text = 'the same as --preset arctan'
    parser.add_argument(
        '--recruitment', dest='preset', choices=('arctan',), default=argparse.SUPPRESS, help=text
    )


def options_of(kind: type[Options], arguments: argparse.Namespace) -> Options:
    """Return a dataclass whose fields are called as options, for those that a command has."""
    names = (name for name in get_type_hints(kind) if hasattr(arguments, name))
    return kind(**{name: getattr(arguments, name) for name in names})


def add_simulation_options(group: 'argparse._ActionsContainer', scenario: str) -> None:
    """Add the simulated muscle and what happens to it; `scenario` ends the help on that."""
    text = (
        'muscle of the simulated identification (Table 4), average magnetic or electrical '
        '(Tables 1 to 3), or random'
    )
    subjects = ('simulation', 'rpms', 'fes', 'random')
    add_option(group, '--subject', 'simulation', text, choices=subjects)
    text = (
        'what happens in the session: fatigue, coil-moved, voluntary, restless, bad-sensor, '
        f'steady, or a YAML file; {scenario}'
    )
    add_option(group, '--scenario NAME|FILE', '', text)


def add_verdict_option(parser: argparse.ArgumentParser) -> None:
    """Add what the verdict takes for granted."""
    text = 'force that this muscle can have at most [N]; more is taken for a wrong unit'
    add_option(parser, '--expected-force N', 200.0, text, type=_positive)


def verdict_code(grade: str, recording: 'Recording') -> int:
    """Return the exit code of a verdict on a recording with or without faults."""
    if grade == 'no':
        return UNUSABLE
    return INCOMPLETE if recording.facts.faults or grade != 'good' else SUCCESS


# What has no meaning for a file of a laboratory.
_OF_RECORDINGS = ('pulses_topic', 'force_topic', 'axis', 'max_memory')


def read(path: Path, arguments: argparse.Namespace) -> 'Recording':
    """Return a recording, or a file of a laboratory as one, as the options say."""
    from rpms_ros.recording import Topics, read_recording

    if hasattr(arguments, 'pulse_unit') and of_a_laboratory(path, arguments):
        from rpms_ros.cli.files import imported_recording

        return imported_recording(path, arguments)
    with progress('reading', None, 'messages', arguments.quiet) as advance:
        topics = Topics(arguments.pulses_topic, arguments.force_topic)
        what = (topics, arguments.axis, arguments.sign)
        return read_recording(path, *what, advance, arguments.max_memory, arguments.quantity)


def of_a_laboratory(path: Path, arguments: argparse.Namespace) -> bool:
    """Return whether it is a file of a laboratory; refuse options of the other kind."""
    from rpms_ros.recording.importing import ImportOptions, is_foreign

    foreign = is_foreign(path)
    given = [] if foreign else options_of(ImportOptions, arguments).given()
    for name in _OF_RECORDINGS if foreign else ():
        default = arguments.parser.get_default(name)
        given += [name] if getattr(arguments, name, default) != default else []
    if given:
        option = given[0].replace('_', '-')
        kind = 'recording' if foreign else 'file of a laboratory'
        raise RecordingError(f'expected --{option} with a {kind}, got {path}')
    return foreign


def warn(findings: Iterable[tuple[str, str]]) -> None:
    """Print each ``name: text`` on stderr."""
    for name, text in findings:
        print(f'rpms: {printable(f"{name}: {text}")}', file=sys.stderr)


def compile_estimator(build: 'Callable[[], Estimator]', quiet: bool) -> None:
    """Compile what an estimator runs, once on a machine; say so on stderr before it begins."""
    from rpms_ros.identification.warm_up import warm_up

    def tell() -> None:
        if not quiet:
            print(f'rpms: {COMPILING}', file=sys.stderr)

    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        # callbacks of numba drop what that raises; it would go on, or fail by what is not compiled
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        warm_up(build, tell, load=False)
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def progress(
    label: str, total: int | None, unit: str, quiet: bool
) -> Iterator[Callable[[int], Any]]:
    """Show a progress bar on a terminal if it takes long; yield the function that advances it."""
    from tqdm import tqdm

    with tqdm(
        desc=label,
        total=total,
        unit=f' {unit}',
        unit_scale=True,
        leave=False,
        delay=_PATIENCE,
        disable=True if quiet else None,
    ) as bar:
        yield bar.update
