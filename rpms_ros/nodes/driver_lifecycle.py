# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A life-cycle node that survives transitions which are not possible.

rclpy of Jazzy lets a `change_state` or a trigger that the state does not allow end the process.
"""

from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode

from rpms_ros.errors import NodeError

Names = dict[int, str]
_LABELS: Names = {
    Transition.TRANSITION_CREATE: 'create',
    Transition.TRANSITION_CONFIGURE: 'configure',
    Transition.TRANSITION_CLEANUP: 'cleanup',
    Transition.TRANSITION_ACTIVATE: 'activate',
    Transition.TRANSITION_DEACTIVATE: 'deactivate',
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_INACTIVE_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_ACTIVE_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_DESTROY: 'destroy',
}


class GuardedLifecycleNode(LifecycleNode):
    """Refuses what the state does not allow; keyword arguments go to `rclpy.node.Node`."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    def possible_transitions(self) -> dict[int, str]:
        """Return number and label of each transition that the state allows."""
        return {
            int(number): str(label)
            for number, label, *_ in self._state_machine.available_transitions
        }

    def change(self, number: int) -> None:
        """Make a transition from within.

        Raises
        ------
        NodeError
            If the state does not allow it.
        """
        possible = self.possible_transitions()
        if number not in possible:
            raise NodeError(_refusal(possible, number))
        triggers = {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
        }
        triggers[number]()  # type: ignore[no-untyped-call]

    def destroy_node(self) -> None:
        """Destroy everything; what rclpy leaves out would keep the name on the graph."""
        self._state_machine.destroy_when_not_in_use()
        LifecycleNode.destroy_node(self)

    def transition_refused(self, reason: str) -> None:
        """Say that a transition was asked for that is not possible; override it."""

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        possible, asked = self.possible_transitions(), request.transition
        if asked.label in possible.values() if asked.label else asked.id in possible:
            return self._change_state(request, response)
        self.transition_refused(_refusal(possible, asked.id, asked.label))
        response.success = False
        return response


def _refusal(possible: Names, number: int, label: str = '') -> str:
    """Return why the state does not allow a transition."""
    asked = label or _LABELS.get(number, str(number))
    if not possible:
        return (
            f'expected a node that is not shut down, got {asked}: no transition is possible any '
            'more, start it again'
        )
    return f'expected a transition of {", ".join(sorted(possible.values()))}, got {asked}'
