"""The action `run_schedule`: one goal at a time, results when the run is over."""

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer
from rclpy.action import CancelResponse
from rclpy.action import GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from rpms_msgs.action import RunSchedule
from rpms_ros.errors import StimulationError
from rpms_ros.nodes import topics
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation import schedule_from_text
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.run import Run


class _DeferredServer(ActionServer):
    """An action server whose goals execute for long without a callback that waits.

    A waiting callback blocks a single-threaded executor, and one that awaits a future is polled
    without a pause in Jazzy.  Here a goal is set executing, and its callback runs at its end.
    """

    def __init__(self, node: Node, **callbacks: Callable[..., Any]) -> None:
        ActionServer.__init__(self, node, RunSchedule, topics.RUN_SCHEDULE, **callbacks)

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[..., Any] | None
    ) -> None:
        """Do nothing yet: the goal is executing from now on."""

    def conclude(self, goal_handle: ServerGoalHandle, callback: Callable[..., Any]) -> None:
        """End a goal: `callback` sets its state and returns its result."""
        ActionServer.notify_execute(self, goal_handle, callback)


class ScheduleAction:
    """Serves `run_schedule` for a node.

    Parameters
    ----------
    node : Node
        Whose executor serves it.
    controller : StimulationController
        What runs the schedules.
    refused : callable
        Told why a goal was refused.
    """

    def __init__(
        self, node: Node, controller: StimulationController, refused: Callable[[str], None]
    ) -> None:
        self._controller = controller
        self._refused = refused
        self._next: Schedule | None = None
        self._goal: ServerGoalHandle | None = None
        self._run: Run | None = None
        self._server = _DeferredServer(
            node,
            execute_callback=self._unused,
            goal_callback=self._on_goal,
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
        feedback = RunSchedule.Feedback()
        feedback.header.stamp = stamp
        feedback.segment = int(run.segment)
        feedback.segments = len(run.schedule.segments)
        feedback.pulses_delivered = int(run.delivered)
        feedback.time_left = float(run.time_left_s(now_ns))
        feedback.coil_energy = float(run.energy_j)
        goal.publish_feedback(feedback)

    def destroy(self) -> None:
        """Let go of the server."""
        ActionServer.destroy(self._server)

    def _on_goal(self, request: RunSchedule.Goal) -> GoalResponse:
        try:
            if self._goal is not None:
                raise StimulationError('expected no schedule running, got a second goal')
            schedule = schedule_from_text(request.schedule)
            self._controller.check_start(schedule)
        except StimulationError as error:
            self._refused(str(error))
            return GoalResponse.REJECT
        self._next = schedule
        return GoalResponse.ACCEPT

    def _on_accepted(self, goal: ServerGoalHandle) -> None:
        schedule, self._next = self._next, None
        goal.execute()
        try:
            if schedule is None:
                raise StimulationError('expected one goal at a time, got two')
            self._run = self._controller.start(schedule)
        except StimulationError as error:
            self._refused(str(error))
            self._server.conclude(goal, _aborted(str(error)))
            return
        self._goal = goal

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        if goal is self._goal:
            self._controller.cancel('cancelled by the client')
        return CancelResponse.ACCEPT

    def _conclude(self, goal: ServerGoalHandle, run: Run) -> None:
        result = RunSchedule.Result(
            completed=bool(run.completed),
            reason=str(run.ended),
            pulses_delivered=int(run.delivered),
            pulses_dropped=int(run.dropped),
            coil_energy=float(run.energy_j),
        )

        def end(handle: ServerGoalHandle) -> RunSchedule.Result:
            if handle.is_cancel_requested:
                handle.canceled()
            elif run.completed:
                handle.succeed()
            else:
                handle.abort()
            return result

        self._server.conclude(goal, end)

    @staticmethod
    def _unused(goal: ServerGoalHandle) -> RunSchedule.Result:
        goal.abort()
        return RunSchedule.Result(reason='expected a deferred execution')


def _aborted(reason: str) -> Callable[[ServerGoalHandle], Any]:
    def end(handle: ServerGoalHandle) -> RunSchedule.Result:
        handle.abort()
        return RunSchedule.Result(reason=reason)

    return end
