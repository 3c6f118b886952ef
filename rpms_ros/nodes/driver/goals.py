# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The action `run_schedule`: one goal at a time, results when the run is over.

Every goal is accepted and answered.  One that is refused is aborted before any pulse, with an
error code and a reason: the answer to a goal that is rejected has room for neither.

Error codes of `run_schedule`: why a goal was refused, and why a run ended.
"""

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from rpms_msgs.action import RunSchedule
from rpms_ros.errors import RpmsError, StimulationError
from rpms_ros.nodes.common import topics
from rpms_ros.nodes.common.diagnostics import plain_text
from rpms_ros.nodes.driver.reports import DriverReports
from rpms_ros.schedule_messages import schedule_of
from rpms_ros.stimulation.driver.authority import AUTHORITY, Authority
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.states import Run, State
from rpms_ros.stimulation.limits.limiter import Interlocked, Refused

CODES = RunSchedule.Result
WATCH = 'watch'
"""Sign of life of the thread that hears what stops the driver."""
UNIQUE = 'unique_driver'
AUDIT = 'audit_log'

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


def code_of(error: RpmsError) -> Any:
    """Return the error code of a goal that was refused because of `error`."""
    if isinstance(error, GoalRefused):
        return error.code
    if not isinstance(error, Refused):
        # the state machine refuses commands with the error of its room
        return CODES.WRONG_STATE
    if error.limit == AUTHORITY:
        return CODES.NO_AUTHORITY
    return CODES.INTERLOCK if isinstance(error, Interlocked) else CODES.OVER_LIMIT


# every status message names all goals that are kept: a flood of them must not slow the executor
_RESULT_TIMEOUT_S = 5


class _DeferredServer(ActionServer):
    """An action server whose goals execute for long without a callback that waits.

    A waiting callback blocks a single-threaded executor, and one that awaits a future is polled
    without a pause in Jazzy.  Here a goal is set executing, and its callback runs at its end.
    """

    def __init__(self, node: Node, **callbacks: Callable[..., Any]) -> None:
        name, timeout_s = topics.RUN_SCHEDULE, _RESULT_TIMEOUT_S
        ActionServer.__init__(self, node, RunSchedule, name, result_timeout=timeout_s, **callbacks)

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[..., Any] | None
    ) -> None:
        """Do nothing yet: the goal is executing from now on."""

    def remove_future(self, future: Any) -> None:
        """Forget a future, if that was not done: a goal may expire while the server goes."""
        if future in self._futures:
            ActionServer.remove_future(self, future)

    def conclude(self, goal: ServerGoalHandle, end: Callable[[Any], None], result: Any) -> None:
        """End a goal: `end` sets its state, and the result is sent."""

        def ended(handle: ServerGoalHandle) -> Any:
            end(handle)
            return result

        ActionServer.notify_execute(self, goal, ended)


class ScheduleAction:
    """Serves `run_schedule` for a node.

    Parameters
    ----------
    node : Node
        Whose executor serves it.
    controller : StimulationController
        What runs the schedules.
    authority : Authority
        Knows who may start a schedule.
    required : bool
        Whether an operator is asked for; if not, anybody may start one while there is none.
    reports : DriverReports
        Announces a schedule before its first pulse, or prevents it; told why a goal was refused.
    """

    def __init__(
        self,
        node: Node,
        controller: StimulationController,
        authority: Authority,
        required: bool,
        reports: DriverReports,
    ) -> None:
        self._controller, self._authority, self._required = controller, authority, required
        self._reports = reports
        self._goal: ServerGoalHandle | None = None
        self._run: Run | None = None
        self._destroyed = False
        self._server = _DeferredServer(
            node,
            # never called: `conclude` ends a goal; rclpy would abort it
            execute_callback=lambda _: RunSchedule.Result(),
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def progress(self, stamp: Any, now_ns: int) -> None:
        """Send feedback, or the result if the run is over; called steadily by the executor."""
        goal, run = self._goal, self._run
        if goal is None or run is None:
            return
        if run.ended:
            self._goal = self._run = None
            self._conclude(goal, run)
            return
        feedback = RunSchedule.Feedback(
            segment=int(run.segment),
            segments=len(run.schedule.segments),
            pulses_delivered=int(run.delivered),
            time_left=float(run.time_left_s(now_ns)),
            coil_energy=float(run.energy_j),
        )
        feedback.header.stamp = stamp
        goal.publish_feedback(feedback)

    def destroy(self) -> None:
        """Let go of the server; once is enough."""
        if not self._destroyed:
            self._destroyed = True
            ActionServer.destroy(self._server)

    def _on_accepted(self, goal: ServerGoalHandle) -> None:
        goal.execute()
        try:
            self._run = self._begun(goal.request)
            self._goal = goal
        except RpmsError as error:
            self._refuse(goal, code_of(error), str(error))
        except Exception as error:  # noqa: BLE001
            # whatever it is, it must neither end the process nor leave the device armed
            reason = f'expected a goal without an error, got {error!r}'
            self._controller.fail('goal', reason)
            self._refuse(goal, CODES.INTERNAL_ERROR, reason)

    def _begun(self, request: RunSchedule.Goal) -> Run:
        """Start what is asked for; the schedule is read only when its sender may ask for it."""
        if self._goal is not None or self._controller.state is State.RUNNING:
            raise GoalRefused(CODES.WRONG_STATE, 'expected no schedule running, got a second goal')
        if self._required or self._authority.confirmed:
            self._authority.require(request.operator_id, request.token)
        try:
            schedule = schedule_of(request.typed_schedule)
        except Exception as error:
            # of anybody, and whatever the reader of it makes of it
            said = f'expected a schedule, got one that raises {error!r}'
            known = isinstance(error, StimulationError)
            raise GoalRefused(CODES.BAD_SCHEDULE, str(error) if known else said) from error
        operator = request.operator_id
        return self._controller.start(schedule, lambda: self._reports.announce(schedule, operator))

    def _refuse(self, goal: ServerGoalHandle, code: int, reason: str) -> None:
        said = plain_text(reason)
        self._reports.refuse(said)
        result = RunSchedule.Result(error_code=code, reason=said)
        self._server.conclude(goal, ServerGoalHandle.abort, result)

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        if goal is self._goal:
            self._controller.cancel('cancelled by the client')
        return CancelResponse.ACCEPT

    def _conclude(self, goal: ServerGoalHandle, run: Run) -> None:
        end = ServerGoalHandle.succeed if run.completed else ServerGoalHandle.abort
        if goal.is_cancel_requested:
            end = ServerGoalHandle.canceled
        result = RunSchedule.Result(
            completed=bool(run.completed),
            error_code=_CODE_OF_CAUSE[run.cause],
            reason=plain_text(run.ended),
            pulses_delivered=int(run.delivered),
            pulses_dropped=int(run.dropped),
            coil_energy=float(run.energy_j),
        )
        self._server.conclude(goal, end, result)
