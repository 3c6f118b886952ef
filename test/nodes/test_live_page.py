# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The live page with the real nodes."""

import time
import urllib.error
import urllib.request

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from std_msgs.msg import Bool, Float64

from rpms_msgs.msg import DriverStatus, MuscleEstimate
from rpms_ros import messages
from rpms_ros.cli import live
from rpms_ros.errors import LiveError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.live_page import UNCONFIRMED, LivePage
from rpms_ros.nodes.stimulator_driver import StimulatorDriver

# of `page`
TOKEN = 'correct-horse-battery'


@pytest.fixture
def stranger(graphs, domain):
    """A node of another participant."""
    with graphs.private_context(domain) as context:
        node = Node('stranger', context=context, use_global_arguments=False)
        yield node
        node.destroy_node()


def post(url, what, token):
    """Status of an answer to a request of the stop."""
    request = urllib.request.Request(f'{url}{what}', method='POST')
    request.add_header('Authorization', f'Bearer {token}')
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_the_stop_stops_a_real_driver_holds_it_and_lets_go(graph, page, driven):
    graph.wait_for(lambda: driven.controller.delivered >= 5, 60.0)
    assert page.stop._button is None  # nobody can count on it: it is not there
    assert post(page.server.url, 'stop', 'wrong-horse-battery') == 403
    graph.wait_for(lambda: driven.controller.delivered >= 8)
    assert page.session.state != 'stopped'
    assert post(page.server.url, 'stop', TOKEN) == 200
    graph.wait_for(lambda: page.session.state == 'stopped')
    delivered = driven.controller.delivered
    # it is held: a reset is refused while the page says pressed
    graph.wait_for(lambda: driven.buttons.pressed)
    assert driven.controller.delivered == delivered
    assert post(page.server.url, 'let_go', TOKEN) == 200
    graph.wait_for(lambda: page.stop._button is None)
    assert page.session.state == 'stopped'
    assert driven.controller.delivered == delivered


def test_a_driver_still_asks_for_a_button(graph, page):
    driver = graph.add(StimulatorDriver, require_operator=False)
    graph.wait_for(lambda: page.session.state == 'unconfigured')
    graph.wait_for(lambda: page.count_subscribers('/emergency_stop') > 0)
    problem = driver.buttons.problem(time.monotonic_ns())
    assert problem == 'expected a stop button that says its state at a rate, got none'


def test_a_page_without_a_token_is_no_button_and_no_client(graph):
    page = graph.add(LivePage, port=0)
    graph.wait_for(lambda: page.server.url and page.session.frame is not None)
    assert page.stop is None
    names = dict(page.get_client_names_and_types_by_node('live_page', '/'))
    assert '/emergency_stop' not in names
    assert post(page.server.url, 'stop', TOKEN) == 403


def test_a_stop_that_no_driver_confirms_says_so(graph, page):
    post(page.server.url, 'stop', TOKEN)
    graph.wait_for(lambda: page.session._stop == {'pressed': True, 'text': UNCONFIRMED})
    # a button that says pressed is there for whoever comes later
    heard = graph.heard(Bool, topics.EMERGENCY_STOP, qos.STOP_LIVE)
    graph.wait_for(lambda: len(heard) > 3)
    assert all(message.data for message in heard)
    # nor is it called one that lasts when it is let go of
    post(page.server.url, 'let_go', TOKEN)
    graph.wait_for(lambda: page.stop._button is None)
    released = {'pressed': False, 'text': f'released; the stop was {UNCONFIRMED}'}
    graph.wait_for(lambda: page.session._stop == released)
    # one that is let go of before the timer of the page looks is said too
    heard.clear()
    page.stop.press()
    page.stop.let_go()
    graph.wait_for(lambda: any(message.data for message in heard))
    graph.wait_for(lambda: page.stop._button is None)
    graph.wait_for(lambda: not heard[-1].data)


def test_a_driver_that_has_ended_confirms_no_stop(graph, page):
    publisher = graph.publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    publisher.publish(DriverStatus(state=DriverStatus.STOPPED, reason='emergency stop'))
    graph.wait_for(lambda: page.session.state == 'stopped')
    # nothing comes any more, and another driver may have taken its place
    driver = page.session.topics['driver_status']
    graph.wait_for(lambda: driver.state(time.monotonic()) == 'silent')
    assert post(page.server.url, 'stop', TOKEN) == 200
    graph.wait_for(lambda: page.session._stop == {'pressed': True, 'text': UNCONFIRMED})
    assert page.session.state == 'stopped'


def test_it_says_what_is_not_heard_and_why(graph, page, stranger):
    # one participant cannot have two types on a topic
    publisher = stranger.create_publisher(Float64, topics.PULSES, 10)
    sensor = graph.publisher(WrenchStamped, topics.FORCE, qos.FORCE_BEST_EFFORT)

    def text(name):
        publisher.publish(Float64(data=1.0))
        return page.session.topics[name].view(time.monotonic())['text']

    graph.wait_for(
        lambda: text('pulses') == 'expected type rpms_msgs/msg/Pulse, got std_msgs/msg/Float64'
    )
    assert 'expected type rpms_msgs/msg/MuscleEstimate' in text('estimate')
    graph.wait_for(lambda: '1 publisher, but nothing has come yet' in text('force'))
    sensor.publish(messages.force_message(10**18, 1.0, (0.0, 0.0, 1.0), MESSAGE_TYPES, 'sensor'))
    graph.wait_for(lambda: page.session.topics['force'].count == 1)
    assert page.session.topics['force'].refused == ''


def test_bytes_that_are_no_message_end_no_page_and_confirm_no_stop(graph, page):
    """As from a driver or an identifier that was built with other message definitions."""
    states = graph.publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    estimates = graph.publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
    states.publish(DriverStatus(state=DriverStatus.STOPPED))
    graph.wait_for(lambda: page.session.confirms_stop(time.monotonic()))
    for name, publisher in (('driver_status', states), ('estimate', estimates)):
        topic = page.session.topics[name]
        publisher.publish(bytes((0, 1, 0, 0, 7, 7, 7)))
        graph.wait_for(lambda: topic.refused or page.server.failure)  # noqa: B023
        assert page.server.failure is None
        assert topic.refused.endswith('got 7 bytes that are none')
        assert topic.view(time.monotonic())['refused']
    # the last state that could be read is not that of now, although something is heard
    driver = page.session.topics['driver_status']
    driver.heard(1, time.monotonic())
    assert page.session.state == 'stopped'
    assert not page.session.confirms_stop(time.monotonic())
    states.publish(DriverStatus(state=DriverStatus.STOPPED))
    graph.wait_for(lambda: page.session.confirms_stop(time.monotonic()))


def test_a_taken_port_is_refused(graph, page):
    with pytest.raises(LiveError, match=f'expected to listen on port {page.server.port} of'):
        graph.add(LivePage, port=page.server.port)


def test_the_address_for_a_phone_is_printed_where_the_network_may_look(capsys):
    live.print_address('127.0.0.1', 'http://127.0.0.1:8765/', '')
    assert capsys.readouterr().out == 'http://127.0.0.1:8765/\n'
    live.print_address('0.0.0.0', 'http://127.0.0.1:8765/', 'correct-horse')
    own, others = capsys.readouterr().out.splitlines()
    assert own == 'http://127.0.0.1:8765/#token=correct-horse'
    assert others == 'elsewhere: http://ADDRESS-OF-THIS-MACHINE:8765/#token=correct-horse'
