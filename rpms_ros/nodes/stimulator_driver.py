"""Node that drives a stimulator: silent until told to run, bounded in everything, stopped by all.

The life cycle: configure opens the device, activate arms it, deactivate disarms, clean-up lets go.
What decides is `rpms_ros.stimulation.controller`; here it meets topics, services and the executor.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn

from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.errors import RpmsError
from rpms_ros.errors import StimulationError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.driver_action import ScheduleAction
from rpms_ros.nodes.driver_diagnostics import diagnostics_message
from rpms_ros.nodes.driver_interlocks import InterlockInputs
from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.nodes.driver_parameters import build_device
from rpms_ros.nodes.driver_parameters import device_specification_of
from rpms_ros.nodes.driver_parameters import driver_settings_of
from rpms_ros.nodes.driver_parameters import schedule_of
from rpms_ros.nodes.driver_priority import ask_for_realtime
from rpms_ros.nodes.driver_status import status_message
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.runner import run
from rpms_ros.pulses import Pulse
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.controller import Fired
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.safety_monitor import EXECUTOR
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.threads import PulseThread
from rpms_ros.stimulation.threads import SupervisorThread

_TICK_S = 0.05
_CLOCK_READINGS = 5
_TIGHT_NS = 50_000
_LONG_NS = 10**18
# how long one thread of Python keeps the others waiting: the pulse thread is one of them
_SWITCH_S = 5e-4
_DIAGNOSTICS_PERIOD_S = 1.0
Callback = Callable[..., TransitionCallbackReturn]


class StimulatorDriver(LifecycleNode):
    """Driver of one stimulator; keyword arguments go to `rclpy.node.Node`."""

    settings_type = DriverParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('stimulator_driver', **options)
        self.settings = declare_parameters(self, DriverParameters)
        self.controller = StimulationController(
            build_device(self.settings),
            device_specification_of(self.settings),
            driver_settings_of(self.settings),
        )
        self._note = ''
        self._active = False
        self._autostart = self.settings.autostart
        self._schedule = schedule_of(self.settings) if self._autostart else None
        self._threads: list[PulseThread | SupervisorThread] = []
        self._next_status_ns = 0
        self._next_diagnostics_ns = 0
        self._said: tuple[Any, ...] = ()
        # Not life-cycle publishers: a pulse that was given is reported whatever the state.
        self._delivered = self.create_publisher(PulseMessage, topics.PULSES, qos.PULSES)
        self._commanded = self.create_publisher(PulseMessage, topics.PULSES_COMMANDED, qos.PULSES)
        self._status = self.create_publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
        self._diagnostics = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, qos.STOP)
        self._action = ScheduleAction(self, self.controller, self._on_refused)
        self._inputs = InterlockInputs(self, self.controller, self.settings, self._on_refused)
        # rclpy lets a transition that is not possible end the process: look before it leaps.
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.context.on_shutdown(self._on_context_shutdown)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the device."""
        done = self._try(self.controller.configure)
        if done is not TransitionCallbackReturn.SUCCESS:
            return done
        self.controller.supervise()
        self._threads = [
            PulseThread(self.controller, self._publish),
            SupervisorThread(self.controller),
        ]
        for thread in self._threads:
            thread.start()
        if self.settings.realtime_priority > 0:
            denied = ask_for_realtime(self.settings.realtime_priority)
            if denied:
                logger_of(self).warning(denied)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Arm; refused while a stop is latched or an interlock is open."""
        self.controller.seen(EXECUTOR)
        done = self._try(self.controller.arm)
        if done is not TransitionCallbackReturn.SUCCESS:
            return done
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disarm."""
        self.controller.disarm()
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the device."""
        self._let_go('device closed')
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the device, from whatever state."""
        self._let_go('shut down')
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go to the safe state: disarmed, device closed, unconfigured."""
        self._let_go('error in a transition')
        super().on_error(state)
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """Let go of the device before anything else of the node goes."""
        self._let_go('node destroyed')
        self._action.destroy()
        LifecycleNode.destroy_node(self)

    def _let_go(self, reason: str) -> None:
        self.controller.cleanup(reason)
        self._active = False
        threads, self._threads = self._threads, []
        for thread in threads:
            thread.close()

    def _try(self, command: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            command()
        except RpmsError as error:
            self._on_refused(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            # rclpy goes to on_error without a word
            self._on_refused(f'expected a transition without an error, got {error!r}')
            raise
        self._note = ''
        return TransitionCallbackReturn.SUCCESS

    def _on_refused(self, reason: str) -> None:
        self._note = f'refused: {reason}'
        logger_of(self).warning(self._note)

    def _on_context_shutdown(self) -> None:
        self.controller.disarm('context shut down')

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        possible = {(id_, label) for id_, label, *_ in self._state_machine.available_transitions}
        asked = request.transition
        if any(
            asked.label == label if asked.label else asked.id == id_ for id_, label in possible
        ):
            return self._change_state(request, response)
        names = ', '.join(sorted(label for _, label in possible))
        self._on_refused(f'expected a transition of {names}, got {asked.label or asked.id}')
        response.success = False
        return response

    def _publish(self, fired: Fired) -> None:
        if not self.context.ok():
            # the process is about to end, and nobody can be told any more
            return
        offset_ns = self._clock_offset_ns()
        given = fired.delivery
        asked = Pulse(fired.due_ns + offset_ns, fired.intensity, fired.sequence, fired.width_s)
        self._commanded.publish(self._message(asked))
        if given is not None:
            sequence = fired.delivered_sequence
            delivered = Pulse(given.time_ns + offset_ns, given.intensity, sequence, fired.width_s)
            self._delivered.publish(self._message(delivered))

    def _message(self, pulse: Pulse) -> PulseMessage:
        return messages.pulse_message(pulse, MESSAGE_TYPES, self.settings.frame_id)

    def _clock_offset_ns(self) -> int:
        """Return the node's clock minus the monotonic clock [ns].

        The thread may be held up between the two readings; the tightest of a few counts.
        """
        best_width, best_offset = _LONG_NS, 0
        for _ in range(_CLOCK_READINGS):
            before = time.monotonic_ns()
            now = self.get_clock().now().nanoseconds
            width = time.monotonic_ns() - before
            if width < best_width:
                best_width, best_offset = width, now - before - width // 2
            if width < _TIGHT_NS:
                break
        return best_offset

    def _tick(self) -> None:
        self.controller.seen(EXECUTOR)
        stamp, now_ns = self.get_clock().now().to_msg(), time.monotonic_ns()
        self._action.progress(stamp, now_ns)
        if self._active and self.controller.state not in (State.ARMED, State.RUNNING):
            # the controller disarmed by itself: the life cycle follows
            LifecycleNode.trigger_deactivate(self)
        if self._autostart:
            self._start_if_heard()
        self._tell(stamp, now_ns)

    def _tell(self, stamp: Any, now_ns: int) -> None:
        """Publish status and diagnostics when it is time, and at once when something changed."""
        said = (*self.controller.status(), self._note)
        changed, self._said = said != self._said, said
        if changed or now_ns >= self._next_status_ns:
            self._next_status_ns = now_ns + nanoseconds(1.0 / self.settings.status_rate)
            self._status.publish(status_message(self.controller, stamp, now_ns, self._note))
        if changed or now_ns >= self._next_diagnostics_ns:
            self._next_diagnostics_ns = now_ns + nanoseconds(_DIAGNOSTICS_PERIOD_S)
            name, device = self.get_name(), self.settings.device
            self._diagnostics.publish(
                diagnostics_message(self.controller, name, device, stamp, self._note)
            )

    def _start_if_heard(self) -> None:
        """Start by itself, once enough nodes listen."""
        if self._delivered.get_subscription_count() < self.settings.minimum_subscribers:
            return
        self._autostart = False
        LifecycleNode.trigger_configure(self)
        if self.controller.state is State.DISARMED:
            LifecycleNode.trigger_activate(self)
        if self.controller.state is State.ARMED and self._schedule is not None:
            try:
                self.controller.start(self._schedule)
            except StimulationError as error:
                self._on_refused(str(error))


def main() -> int:
    """Run the stimulator driver as a process."""
    sys.setswitchinterval(_SWITCH_S)
    return run(StimulatorDriver)
