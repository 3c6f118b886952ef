# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A transition that is not possible is refused by its name, also when none is left."""

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from rpms_ros.errors import NodeError
from rpms_ros.nodes.stimulator_driver import GuardedLifecycleNode


class Refusing(GuardedLifecycleNode):
    """Keeps why transitions were refused."""

    def __init__(self, **options):
        super().__init__('refusing', **options)
        self.reasons = []

    def transition_refused(self, reason):
        self.reasons.append(reason)

    def asked(self, number, label=''):
        """Return why a request is refused."""
        request = ChangeState.Request(transition=Transition(id=number, label=label))
        response = self._on_change_state(request, ChangeState.Response(success=True))
        assert not response.success
        return self.reasons[-1]


@pytest.fixture(name='node')
def node_fixture(graph):
    return graph.add(Refusing)


@pytest.mark.parametrize(
    ('number', 'label', 'named'),
    [
        (Transition.TRANSITION_ACTIVATE, '', 'activate'),
        (Transition.TRANSITION_ACTIVE_SHUTDOWN, '', 'active_shutdown'),
        (0, 'dance', 'dance'),
        (77, '', '77'),
    ],
)
def test_what_is_asked_for_is_named(node, number, label, named):
    said = f'expected a transition of configure, shutdown, got {named}'
    assert node.asked(number, label) == said


def test_nothing_is_possible_after_a_shutdown(node):
    node.trigger_shutdown()
    said = 'expected a node that is not shut down, got configure: no transition is possible'
    assert node.asked(Transition.TRANSITION_CONFIGURE).startswith(said)
    with pytest.raises(NodeError, match=said):
        node.change(Transition.TRANSITION_CONFIGURE)
