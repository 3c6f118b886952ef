# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Error codes of `run_schedule`: why a goal was refused, and why a run ended."""

from typing import Any

from rpms_msgs.action import RunSchedule
from rpms_ros.errors import RpmsError
from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.authority import AUTHORITY
from rpms_ros.stimulation.interlocks import SUSPEND
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.run import Run
from rpms_ros.stimulation.safety_monitor import EMERGENCY_STOP
from rpms_ros.stimulation.safety_monitor import EXECUTOR
from rpms_ros.stimulation.safety_monitor import FORCE
from rpms_ros.stimulation.safety_monitor import HEARTBEAT
from rpms_ros.stimulation.safety_monitor import SUPERVISOR

CODES = RunSchedule.Result
WATCH = 'watch'
"""Sign of life of the thread that hears what stops the driver."""
UNIQUE = 'unique_driver'
AUDIT = 'audit_log'
_OF_THE_CONTROLLER = (EMERGENCY_STOP, EXECUTOR, FORCE, HEARTBEAT, SUPERVISOR, SUSPEND)
INTERLOCKS = frozenset(('stop', 'force_limit', *_OF_THE_CONTROLLER, AUDIT, UNIQUE, WATCH))
"""What a refusal may name that is no limit of device, coil or patient."""


_CODE_OF_CAUSE = {
    'completed': CODES.NONE,
    'incomplete': CODES.INCOMPLETE,
    'cancelled': CODES.CANCELLED,
    'limit': CODES.OVER_LIMIT,
    'disarmed': CODES.WRONG_STATE,
    'stopped': CODES.INTERLOCK,
    'fault': CODES.DEVICE_FAULT,
}


class GoalRefused(StimulationError):
    """A goal is not run; ``code`` is the error code of its result."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


def code_of(error: RpmsError) -> int:
    """Return the error code of a goal that was refused because of `error`."""
    return int(_code_of(error))


def _code_of(error: RpmsError) -> Any:
    if isinstance(error, GoalRefused):
        return error.code
    if not isinstance(error, Refused):
        # the state machine refuses commands with the error of its room
        return CODES.WRONG_STATE
    if error.limit == AUTHORITY:
        return CODES.NO_AUTHORITY
    return CODES.INTERLOCK if error.limit in INTERLOCKS else CODES.OVER_LIMIT


def code_of_end(run: Run) -> int:
    """Return the error code of a run that is over."""
    return int(_CODE_OF_CAUSE[run.cause])
