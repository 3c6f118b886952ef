# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state machine of a driver: which command is legal in which state, and where it leads.

A stop is latched beside the state, because it has to work in every one of them: it takes the
state to where no pulse is possible and keeps it from being armed until it is reset.
"""

import enum

from rpms_ros.errors import StimulationError


class State(enum.Enum):
    """Where a driver is; values as in rpms_msgs/DriverStatus."""

    UNCONFIGURED = 0
    DISARMED = 1
    ARMED = 2
    RUNNING = 3
    FAULT = 5


class Command(enum.Enum):
    """What may be asked of a driver, or happen to it."""

    CONFIGURE = 'configure'
    ARM = 'arm'
    START = 'start'
    FINISH = 'finish'
    DISARM = 'disarm'
    CLEANUP = 'cleanup'
    FAIL = 'fail'
    STOP = 'stop'


TRANSITIONS: dict[tuple[State, Command], State] = {
    (State.UNCONFIGURED, Command.CONFIGURE): State.DISARMED,
    (State.DISARMED, Command.ARM): State.ARMED,
    (State.ARMED, Command.START): State.RUNNING,
    (State.RUNNING, Command.FINISH): State.DISARMED,
    # what makes pulses impossible is legal everywhere; no device is open when unconfigured, so
    # there is no fault to clean up
    (State.UNCONFIGURED, Command.DISARM): State.UNCONFIGURED,
    (State.DISARMED, Command.DISARM): State.DISARMED,
    (State.ARMED, Command.DISARM): State.DISARMED,
    (State.RUNNING, Command.DISARM): State.DISARMED,
    (State.FAULT, Command.DISARM): State.FAULT,
    (State.UNCONFIGURED, Command.STOP): State.UNCONFIGURED,
    (State.DISARMED, Command.STOP): State.DISARMED,
    (State.ARMED, Command.STOP): State.DISARMED,
    (State.RUNNING, Command.STOP): State.DISARMED,
    (State.FAULT, Command.STOP): State.FAULT,
    (State.UNCONFIGURED, Command.FAIL): State.UNCONFIGURED,
    (State.DISARMED, Command.FAIL): State.FAULT,
    (State.ARMED, Command.FAIL): State.FAULT,
    (State.RUNNING, Command.FAIL): State.FAULT,
    (State.FAULT, Command.FAIL): State.FAULT,
    (State.UNCONFIGURED, Command.CLEANUP): State.UNCONFIGURED,
    (State.DISARMED, Command.CLEANUP): State.UNCONFIGURED,
    (State.ARMED, Command.CLEANUP): State.UNCONFIGURED,
    (State.RUNNING, Command.CLEANUP): State.UNCONFIGURED,
    (State.FAULT, Command.CLEANUP): State.UNCONFIGURED,
}
"""Every legal transition; any other pair is refused and changes nothing."""


def after(state: State, command: Command) -> State:
    """Return the state that ``command`` leads to from ``state``.

    Raises
    ------
    StimulationError
        If the command is not legal there.
    """
    found = TRANSITIONS.get((state, command))
    if found is None:
        legal = sorted(source.name for source, what in TRANSITIONS if what is command)
        raise StimulationError(
            f'{command.value}: expected state {" or ".join(legal)}, got {state.name}'
        )
    return found
