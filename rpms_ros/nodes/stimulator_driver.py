# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that drives a stimulator: pulses only when armed and started, and only within limits.

Life cycle: configure opens the device, activate arms it, deactivate disarms, clean-up closes it.
`rpms_ros.stimulation.driver.controller` decides; this node connects it to topics, services and
timers.  Buttons and the operator's heartbeat are heard by `driver.watch`, without the executor.

rclpy of Jazzy lets a `change_state` or a trigger that the state does not allow end the process:
here it is refused.
"""

import dataclasses
import math
import os
import time
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from rpms_msgs.srv import ConfirmArming, RequestArming
from rpms_ros import messages
from rpms_ros.errors import NodeError, RpmsError, StimulationError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import logger_of, plain_text
from rpms_ros.nodes.common.parameters import declare_parameters, refuse_unknown
from rpms_ros.nodes.common.runner import complete_or_gone, every, run, stay_on_this_machine
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.driver.goals import AUDIT, ScheduleAction
from rpms_ros.nodes.driver.parameters import (
    DriverParameters,
    build_device,
    driver_settings_of,
    ledger_of,
    patience_s,
    session_of,
)
from rpms_ros.nodes.driver.reports import DriverAudit, DriverReports, PulsePublisher
from rpms_ros.nodes.driver.watch import WATCH_TIMEOUT_S, DriverWatch
from rpms_ros.stimulation import Schedule, load_schedule
from rpms_ros.stimulation.driver.authority import AUTHORITY, Authority
from rpms_ros.stimulation.driver.controller import ControllerThreads, StimulationController
from rpms_ros.stimulation.driver.safety_monitor import EXECUTOR, SensorLife
from rpms_ros.stimulation.driver.states import POSSIBLE, State
from rpms_ros.stimulation.driver.stop_buttons import StopButtons
from rpms_ros.stimulation.limits.limiter import Refused

_LABELS: dict[int, str] = {
    getattr(Transition, name): name.removeprefix('TRANSITION_').lower()
    for name in dir(Transition)
    if name.startswith('TRANSITION_')
}


def _refusal(possible: Collection[str], asked: str) -> str:
    """Return why the state does not allow a transition."""
    if not possible:
        fault = f'expected a node that is not shut down, got {asked}'
        return f'{fault}: no transition is possible any more, start it again'
    return f'expected a transition of {", ".join(sorted(possible))}, got {asked}'


_SIMULATED_TIME = 'use_sim_time'
_BY_THE_CLOCK = 'expected use_sim_time false: a driver stamps what it does by the clock, got true'


class StimulatorDriver(LifecycleNode):
    """Driver of one stimulator; keyword arguments go to `rclpy.node.Node`."""

    settings_type = DriverParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('stimulator_driver', **options)
        # rclpy ends the node where a state does not allow what is asked for
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        with complete_or_gone(self) as self._parts:
            self._build()
            self._parts.callback(self._let_go, 'node destroyed')

    def _build(self) -> None:
        """Make the parts of the node, each after those that it depends on."""
        if self.get_parameter(_SIMULATED_TIME).value:
            raise NodeError(_BY_THE_CLOCK)
        # a misspelt limit must not count as one that was left out
        self.settings = settings = declare_parameters(self, DriverParameters, refuse_misspelt=True)
        if not settings.simulated:
            refuse_unknown(self)
        self._session = session_of(settings)
        ledger = ledger_of(settings, self._session)
        self._parts.callback(ledger.close)
        self.controller = StimulationController(
            build_device(settings, self._session.specification),
            self._session.specification,
            driver_settings_of(settings),
            ledger=ledger,
        )
        self.authority = Authority(settings.heartbeat_timeout)
        self.buttons = StopButtons(
            settings.stop_button_timeout, settings.require_stop_button, settings.stop_buttons
        )
        device = settings.device if settings.simulated else f'{settings.device} {settings.port}'
        self._active = False
        # started once there are enough subscribers, without an operator
        self._autostart: Schedule | None = None
        if settings.autostart:
            self._autostart = load_schedule(Path(settings.schedule_file).expanduser())
        self._audit = DriverAudit(settings.audit_log, partial(self.controller.open, AUDIT))
        self._parts.callback(self._audit.close)
        self._pulses = PulsePublisher(self)
        # with pulses that were on their way when it was disarmed
        self._parts.callback(lambda: self._audit.note('end', **self._pulses.hash.for_the_log()))
        self._threads = ControllerThreads(self.controller)
        self._parts.callback(self._threads.close)
        name = self.get_fully_qualified_name()
        self._audit.require('session', driver=name, device=device, process=os.getpid())
        self.controller.on_fired = self._pulses.publish
        who = self.controller, self.buttons, self.authority
        self._reports = DriverReports(self, self._audit, *who, device)
        self.create_service(RequestArming, topics.REQUEST_ARMING, self._on_request)
        self.create_service(ConfirmArming, topics.CONFIRM_ARMING, self._on_confirm)
        asked, patience = settings.require_operator, patience_s(settings, WATCH_TIMEOUT_S)
        self._action = ScheduleAction(self, self.controller, self.authority, asked, self._reports)
        self._parts.callback(self._action.destroy)
        self._watch = DriverWatch(self, *who, patience, self._reports.refuse)
        self._parts.callback(self._watch.close)
        self._sensor = SensorLife(settings.force_frame, settings.force_timeout)
        if settings.force_limit > 0:
            self.create_subscription(
                WrenchStamped, topics.FORCE, self._on_force, qos.FORCE_BEST_EFFORT
            )
        self.create_service(Trigger, topics.RESET_EMERGENCY_STOP, self._on_reset)
        self.add_on_set_parameters_callback(self._allow_change)
        self.add_post_set_parameters_callback(self._on_change)
        every(self, 0.01, lambda: self.controller.seen(EXECUTOR))
        every(self, 0.05, self._guarded_tick)
        # a bound method, which rclpy holds weakly
        self.context.on_shutdown(self._on_context_shutdown)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the device."""
        self._threads.start()
        if not self._try(self._configure):
            return TransitionCallbackReturn.FAILURE
        self._reports.say('configured: device open, disarmed')
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Arm; refused while a stop is latched or an interlock is open."""
        if not self._try(self._make_ready):
            return TransitionCallbackReturn.FAILURE
        self._active = True
        self._reports.say(f'armed by {self.authority.operator or "nobody in particular"}')
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disarm."""
        self.controller.disarm()
        self._after_disarming()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the device."""
        self._let_go('device closed')
        self.buttons.clear()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the device, in any state."""
        self._let_go('shut down')
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go to the safe state: disarmed, device closed, unconfigured."""
        self._let_go('error in a transition')
        super().on_error(state)
        return TransitionCallbackReturn.SUCCESS

    def stop_at_once(self, reason: str) -> None:
        """Stop because the process is about to end; any thread may call it, at any time."""
        # latched: nothing begins while the node tells how it ended
        self.controller.stop('signal', reason)
        self._audit.note('signal', reason=reason)

    def destroy_node(self) -> None:
        """Close the device before anything else of the node is destroyed."""
        self._parts.close()
        # what rclpy leaves out would keep the name on the graph
        self._state_machine.destroy_when_not_in_use()
        LifecycleNode.destroy_node(self)

    def change(self, label: str) -> None:
        """Make a transition from within.

        Raises
        ------
        NodeError
            If the state does not allow it.
        """
        possible = self._possible()
        if label not in possible.values():
            raise NodeError(_refusal(possible.values(), label))
        getattr(self, f'trigger_{label}')()

    def _possible(self) -> dict[int, str]:
        """Return number and label of each transition that the state allows."""
        return {number: label for number, label, *_ in self._state_machine.available_transitions}

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        possible, asked = self._possible(), request.transition
        if asked.label in possible.values() if asked.label else asked.id in possible:
            return self._change_state(request, response)
        label = asked.label or _LABELS.get(asked.id, str(asked.id))
        if label == 'cleanup':
            self.controller.disarm('a clean-up was asked for')
        self._reports.refuse(_refusal(possible.values(), label))
        response.success = False
        return response

    def _configure(self) -> None:
        self._audit.require('configure', specification=self.controller.specification.name)
        self.controller.configure()

    def _make_ready(self) -> None:
        """Arm, if the operator is allowed to."""
        if self.settings.require_operator and not self.authority.confirmed:
            expected = 'expected an operator to request and to confirm the arming, got neither'
            raise Refused(AUTHORITY, expected)
        self._session.require_unchanged()
        self._watch.look()
        self.controller.seen(EXECUTOR)
        limits = {key: str(value) for key, value in vars(self.controller.limits).items()}
        self._audit.require('arm', operator=self.authority.operator, limits=limits)
        self.controller.arm()

    def _arm(self) -> None:
        """Arm by a transition of the life cycle; raise StimulationError if that fails."""
        try:
            self.change('activate')
        except NodeError as error:
            raise StimulationError(str(error)) from error
        if self.controller.state not in POSSIBLE:
            reason = self._reports.refusal
            raise StimulationError(reason or 'expected an armed driver, got a disarmed one')

    def _let_go(self, reason: str) -> None:
        self.controller.cleanup(reason)
        self._after_disarming()

    def _after_disarming(self) -> None:
        """Report it and release the operator: arming again begins with the first step."""
        if self._active:
            _, latched, reason = self.controller.status()
            self._reports.say(f'{"stopped" if latched else "disarmed"}: {reason}')
            kind, given = 'stop' if latched else 'disarm', self._pulses.hash.for_the_log()
            self._audit.note(kind, reason=plain_text(reason), **given)
        self._active = False
        self.authority.release()

    def _try(self, command: Callable[[], None]) -> bool:
        """Return whether what a transition asks for was done; tell why it was refused."""
        try:
            command()
        except RpmsError as error:
            self._reports.refuse(str(error))
            return False
        except Exception as error:
            # rclpy calls on_error without a message
            self._reports.refuse(f'expected a transition without an error, got {error!r}')
            raise
        self._reports.refusal = ''
        return True

    def _answered(self, response: Any, act: Callable[[], str]) -> Any:
        """Do what a service is asked for; answer with what was done, or why it was refused."""
        try:
            response.message, response.success = act(), True
        except StimulationError as error:
            response.message = plain_text(error)
            self._reports.refuse(response.message)
        return response

    def _on_request(
        self, request: RequestArming.Request, response: RequestArming.Response
    ) -> RequestArming.Response:
        def give_token() -> str:
            if not self._possible():
                raise StimulationError(_refusal((), 'a request to arm'))
            response.token = self.authority.request(request.operator_id, time.monotonic_ns())
            response.valid_for = float(self.authority.valid_s)
            return 'hold the enable, send heartbeats with the token, then confirm'

        return self._answered(response, give_token)

    def _on_confirm(
        self, request: ConfirmArming.Request, response: ConfirmArming.Response
    ) -> ConfirmArming.Response:
        def confirm() -> str:
            if self.authority.confirmed:
                raise Refused(AUTHORITY, 'expected one confirmation, got another one')
            self.authority.confirm(request.operator_id, request.token, time.monotonic_ns())
            try:
                self._arm()
            except StimulationError:
                # the token can be confirmed again in its time
                self.authority.confirmed = False
                raise
            return 'armed'

        return self._answered(response, confirm)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def reset() -> str:
            # a stop of this moment is told and logged before it is reset
            self._guarded_tick()
            self._watch.forget_gone()
            what = 'reset' if self.controller.reset() else 'no stop was latched'
            said = f'{what}; the driver is {self.controller.state.name.lower()}'
            self._reports.say(said)
            self._audit.note('reset')
            return said

        return self._answered(response, reset)

    def _on_force(self, message: WrenchStamped) -> None:
        """Hold every sample against the limit; not every one is a sign of life."""
        force = getattr(message.wrench, self.settings.quantity)
        size = math.hypot(force.x, force.y, force.z)
        stamp_ns = messages.nanoseconds(message.header.stamp)
        refusal = self._sensor.refusal(stamp_ns, message.header.frame_id, time.time_ns())
        if refusal is None:
            self.controller.force(size)
            return
        self.controller.count('force_refused')
        self._reports.refuse(refusal)
        if not size <= self.settings.force_limit:
            self.controller.force(size)

    def _on_context_shutdown(self) -> None:
        self.controller.disarm('context shut down')

    def _allow_change(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse simulated time, and a bound on the intensity that cannot be set now."""
        try:
            if any(given.name == _SIMULATED_TIME and given.value for given in parameters):
                raise NodeError(_BY_THE_CLOCK)
            for bound in self._new_bounds(parameters):
                self.controller.require_bound(bound)
        except RpmsError as error:
            self._reports.refuse(str(error))
            return SetParametersResult(successful=False, reason=plain_text(error))
        return SetParametersResult(successful=True)

    def _on_change(self, parameters: list[Parameter]) -> None:
        # only a parameter that was set moves it: a change may be refused by any callback
        for bound in self._new_bounds(parameters):
            try:
                self.controller.tighten(bound)
            except StimulationError as error:
                # armed since the check, by another thread: the lower bound stays in force
                self._reports.refuse(str(error))
                return
            self.settings = dataclasses.replace(self.settings, maximum_intensity=bound)
            self._reports.say(f'intensities up to {bound:g}')
            self._audit.note('limit', maximum_intensity=bound)

    def _new_bounds(self, parameters: list[Parameter]) -> list[float]:
        """Return the bounds on the intensity that are new; raise NodeError for what is none."""
        # of several the last is the parameter's value
        given = [one.value for one in parameters if one.name == 'maximum_intensity'][-1:]
        asked = [dataclasses.replace(self.settings, maximum_intensity=value) for value in given]
        return [one.maximum_intensity for one in asked if one != self.settings]

    def _guarded_tick(self) -> None:
        try:
            self._tick()
        except Exception as error:  # noqa: BLE001
            # an exception in a timer would end the process with the device armed
            self.controller.fail('tick', f'expected to run on, got {error!r}')
            logger_of(self).error(f'expected to run on, got {error!r}', throttle_duration_sec=1.0)

    def _tick(self) -> None:
        stamp, now_ns = messages.time_message(time.time_ns(), MESSAGE_TYPES), time.monotonic_ns()
        self._action.progress(stamp, now_ns)
        if self._active and self.controller.state not in POSSIBLE:
            # the controller has disarmed: deactivate the life cycle too
            self.change('deactivate')
        if self._autostart and self._pulses.listeners >= self.settings.minimum_subscribers:
            schedule, self._autostart = self._autostart, None
            self._start(schedule)
        self._reports.publish(stamp, now_ns)

    def _start(self, schedule: Schedule) -> None:
        try:
            if self.controller.state is State.UNCONFIGURED:
                self.change('configure')
            if self.controller.state is State.DISARMED:
                self.change('activate')
            if self.controller.state is State.ARMED:
                self.controller.start(schedule, lambda: self._reports.announce(schedule, ''))
        except RpmsError as error:
            self._reports.refuse(str(error))


def main() -> int:
    """Run the stimulator driver as a process."""
    stay_on_this_machine()
    return run(StimulatorDriver)
