# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The live page with the real nodes, and in a real browser without a window."""

import json
import os
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import Bool
from std_msgs.msg import Float64

from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import MuscleEstimate
from rpms_ros import messages
from rpms_ros.errors import LiveError
from rpms_ros.errors import NodeError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.live_stop import UNCONFIRMED
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver

RPMS = [sys.executable, '-c', 'import sys; from rpms_ros.cli import main; sys.exit(main())']
TOKEN = 'correct-horse-battery'
# a machine under load may stall for longer than the defaults allow
PATIENT = {'executor_timeout': 5.0, 'watch_timeout': 5.0, 'stop_button_timeout': 5.0}


@pytest.fixture
def page(graph):
    """A page with a stop, on a free port."""
    return graph.add(lambda **options: LivePage(TOKEN, **options), port=0)


@pytest.fixture
def driven(graph):
    """A simulated muscle that is stimulated for a minute, and its identifier."""
    identifier = graph.add(Identifier, estimator='horizon')
    graph.add(PlantSimulator, minimum_subscribers=2, publication_delay=0.05, noise=0.02)
    driver = graph.add(
        StimulatorDriver,
        autostart=True,
        require_operator=False,
        require_stop_button=False,
        minimum_subscribers=3,
        duration=60.0,
        low=0.2,
        **PATIENT,
    )
    return identifier, driver


@pytest.fixture
def stranger(domain):
    """A node of another participant."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    node = Node('stranger', context=context, use_global_arguments=False)
    yield node
    node.destroy_node()
    context.try_shutdown()


def post(url, what, token):
    """Status of an answer to a request of the stop."""
    request = urllib.request.Request(f'{url}{what}', method='POST')
    request.add_header('Authorization', f'Bearer {token}')
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


@pytest.fixture
def browser(beside, tmp_path):
    """A browser on a screen of 1100 px."""
    with beside('devtools').Browser(tmp_path / 'profile') as running:
        running.screen(1100)
        yield running


def test_the_stop_stops_a_real_driver_holds_it_and_lets_go(graph, page, driven):
    _, driver = driven
    graph.wait_for(lambda: driver.controller.delivered >= 5, 60.0)
    assert page.stop._button is None  # nobody can count on it: it is not there
    assert post(page.server.url, 'stop', 'wrong-horse-battery') == 403
    graph.wait_for(lambda: driver.controller.delivered >= 8)
    assert not page.session.stopped
    assert post(page.server.url, 'stop', TOKEN) == 200
    graph.wait_for(lambda: page.session.stopped)
    delivered = driver.controller.delivered
    # it is held: a reset is refused while the page says pressed
    graph.wait_for(lambda: driver.buttons.pressed)
    assert driver.controller.delivered == delivered
    assert post(page.server.url, 'let_go', TOKEN) == 200
    graph.wait_for(lambda: page.stop._button is None)
    assert page.session.stopped
    assert driver.controller.delivered == delivered


def test_the_stop_button_in_the_browser_stops_a_real_driver(graph, page, driven, browser):
    _, driver = driven
    browser.open(f'{page.server.url}#token={TOKEN}')
    graph.wait_for(lambda: driver.controller.delivered >= 5, 60.0)
    graph.wait_for(lambda: browser.text('#state').startswith('running'))
    browser.evaluate("document.getElementById('stop').click()")
    graph.wait_for(lambda: browser.text('#state').startswith('stopped'))
    delivered = driver.controller.delivered
    graph.wait_for(lambda: 'the driver confirms it' in browser.text('#stopped'))
    browser.wait_for("!document.getElementById('let-go').hidden")
    browser.evaluate("document.getElementById('let-go').click()")
    graph.wait_for(lambda: page.stop._button is None)
    # let go of here, stopped there
    assert browser.text('#state').startswith('stopped')
    assert driver.controller.delivered == delivered


def test_a_driver_still_asks_for_a_button(graph, page):
    driver = graph.add(
        StimulatorDriver, require_stop_button=True, require_operator=False, **PATIENT
    )
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
    heard = []
    listener = graph.add(lambda **options: Node('listener', **options))
    listener.create_subscription(Bool, topics.EMERGENCY_STOP, heard.append, qos.STOP_LIVE)
    graph.wait_for(lambda: len(heard) > 3)
    assert all(message.data for message in heard)


def test_it_says_what_is_not_heard_and_why(graph, page, stranger):
    # one participant cannot have two types on a topic
    publisher = stranger.create_publisher(Float64, topics.PULSES, 10)
    other = graph.add(lambda **options: Node('other', **options))
    sensor = other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE_BEST_EFFORT)
    other.create_subscription(WrenchStamped, topics.FORCE, print, qos.FORCE)

    def text(name):
        publisher.publish(Float64(data=1.0))
        return page.session.topics[name].view(time.monotonic())['text']

    graph.wait_for(
        lambda: text('pulses') == 'expected type rpms_msgs/msg/Pulse, got std_msgs/msg/Float64'
    )
    assert 'expected type rpms_msgs/msg/MuscleEstimate' in text('estimate')
    graph.wait_for(lambda: 'other does not hear /other: it asks for reliable' in text('force'))
    assert '1 publisher, but nothing has come yet' in text('force')
    sensor.publish(messages.force_message(10**18, 1.0, (0.0, 0.0, 1.0), MESSAGE_TYPES, 'sensor'))
    graph.wait_for(lambda: page.session.bins.last == 1.0)
    assert page.session.topics['force'].count == 1


def test_messages_that_fit_nothing_are_named_and_harm_nobody(graph, page):
    other = graph.add(lambda **options: Node('other', **options))
    publisher = other.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
    graph.wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(MuscleEstimate(nonlinear_names=['u_thr'], nonlinear=[1.0, 2.0]))

    def text():
        return page.session.topics['estimate'].view(time.monotonic())['text']

    graph.wait_for(lambda: 'not shown: expected 1 elements in nonlinear, got 2' in text())
    publisher.publish(MuscleEstimate(estimator='mine'))
    graph.wait_for(lambda: 'not shown' not in text())
    assert page.server.failure is None


def test_a_taken_port_and_a_bad_token_are_refused(graph, page):
    with pytest.raises(LiveError, match=f'expected to listen on port {page.server.port} of'):
        graph.add(LivePage, port=page.server.port)
    with pytest.raises(LiveError, match='expected a token of 16 to 200 characters, got 5'):
        graph.add(lambda **options: LivePage('short', **options), port=0)
    with pytest.raises(NodeError, match='parameter sign: expected 1 or -1, got 0'):
        graph.add(LivePage, port=0, sign=0)


@pytest.mark.usefixtures('driven')
def test_a_recording_made_beside_lacks_nothing(graph, page, tmp_path):
    recorder = graph.add(Recorder, path=str(tmp_path / 'recording'))
    url = page.server.url.replace('http', 'ws') + 'stream'
    code = (
        'import asyncio, sys\nfrom tornado.websocket import websocket_connect\n'
        'async def main():\n    socket = await websocket_connect(sys.argv[1])\n'
        '    print("seen", flush=True)\n'
        '    while await socket.read_message() is not None:\n'
        '        await socket.write_message("n")\n'
        'asyncio.run(main())\n'
    )
    browsers = [
        subprocess.Popen([sys.executable, '-c', code, url], stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    try:
        graph.wait_for(lambda: len(page.server.browsers) == 2, 60.0)
        first = recorder.counts['force'].messages
        graph.wait_for(lambda: recorder.counts['force'].messages > first + 2000, 60.0)
        assert recorder.counts['force'].missing(1000.0) == 0
    finally:
        for one in browsers:
            one.terminate()
            one.communicate()


def contrast(browser):
    """The smallest contrast of a text against its background, and whose it is."""
    return browser.evaluate(
        """(() => {
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = (colour) => {
    const [r, g, b] = colour.map((v) => v / 255)
      .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const colour = rgb(getComputedStyle(at).backgroundColor);
      if (colour.length < 4 || colour[3] > 0) { return colour.slice(0, 3); }
    }
    return [255, 255, 255];
  };
  let worst = [99, ''];
  for (const one of document.querySelectorAll('body *')) {
    const said = [...one.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!said || !one.offsetParent || one.tagName === 'SCRIPT') { continue; }
    const [a, b] = [light(rgb(getComputedStyle(one).color).slice(0, 3)), light(behind(one))];
    const found = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (found < worst[0]) { worst = [found, one.outerHTML.slice(0, 80)]; }
  }
  return worst;
})()"""
    )


UNLABELLED = """[...document.querySelectorAll('button, input, [role=img]')].filter((one) =>
  !(one.textContent.trim() || one.getAttribute('aria-label')
    || (one.labels && one.labels.length))).map((one) => one.outerHTML)"""
UNCAPTIONED = """[...document.querySelectorAll('table')].filter((one) =>
  !one.caption || [...one.querySelectorAll('th')].some((head) => !head.scope)).length"""


@pytest.mark.usefixtures('driven')
def test_the_page_shows_a_living_session(graph, page, browser):
    url = page.server.url
    browser.open(url)

    def shown(expression):
        return lambda: browser.evaluate(expression)

    graph.wait_for(
        shown("document.getElementById('curve-text').textContent.includes(' N; 95 % band')"), 90.0
    )
    graph.wait_for(shown("document.getElementById('state').textContent.startsWith('running')"))
    graph.wait_for(shown('plots.pulses.time.length > 20'), 60.0)
    # the force moves, and the model beside it
    before = browser.evaluate('plots.force.time.length')
    graph.wait_for(shown(f'plots.force.time.length > {before} + 100'), 60.0)
    low, modelled = browser.evaluate('[plots.force.low, plots.force.modelled]')
    known = [(a, b) for a, b in zip(low, modelled, strict=True) if None not in (a, b)]
    assert len(known) > 100
    # what is drawn is what was published: the canvas is not empty
    assert (
        browser.evaluate(
            """(() => { const c = document.querySelector('#force-plot canvas');
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let n = 0; for (let i = 3; i < d.length; i += 4) { n += d[i] > 200; } return n; })()"""
        )
        > 500
    )
    rows = browser.evaluate(
        "[...document.querySelectorAll('#parameter-rows tr')].map((row) => row.textContent)"
    )
    assert any(row.startswith('u_thr') for row in rows)
    assert 'delivered' in browser.text('#driver-facts')
    # nothing from elsewhere, nothing to complain of
    assert {address.partition('//')[2].partition('/')[0] for address in browser.requested()} == {
        f'127.0.0.1:{page.server.port}'
    }
    assert browser.complaints() == []


def test_anybody_can_read_and_use_it(graph, page, browser):
    """Contrast, labels, keyboard, a phone's width, light and dark."""
    url = f'{page.server.url}#token={TOKEN}'
    hostile(graph)
    browser.open(url)
    browser.wait_for("!document.getElementById('stop').hidden && plots.force.time.length > 10")
    # the token is out of the address
    assert browser.evaluate('location.hash + location.search') == ''
    browser.wait_for("document.querySelectorAll('#fault-rows tr').length > 0")
    for dark in (False, True):
        for width in (360, 1100):
            browser.screen(width, dark=dark)
            browser.evaluate('new Promise((done) => requestAnimationFrame(() => done(1)))')
            least, whose = contrast(browser)
            # WCAG 2.2, level AA for small text
            assert least >= 4.5, (dark, whose)
            assert browser.evaluate('document.documentElement.scrollWidth - innerWidth') <= 0
            assert browser.accessibility_faults() == [], (dark, width)
    assert browser.evaluate(UNLABELLED) == []
    assert browser.evaluate(UNCAPTIONED) == 0
    assert browser.evaluate('document.documentElement.lang') == 'en'
    browser.evaluate('document.activeElement.blur()')
    for _ in range(2):
        browser.press('Tab')
    # the link that skips, then the stop
    assert browser.evaluate('document.activeElement.id') == 'stop'
    assert browser.evaluate('getComputedStyle(document.activeElement).outlineStyle') == 'solid'
    for role in ('#state', '#stopped', '#connection', '#doubt-text'):
        assert browser.evaluate(f"document.querySelector('{role}').getAttribute('role')")
    browser.press('Enter')
    graph.wait_for(lambda: page.stop._button is not None)
    graph.wait_for(lambda: browser.text('#stopped') == UNCONFIRMED)
    assert browser.complaints() == []
    # what finds nothing does look
    browser.evaluate(
        "document.documentElement.removeAttribute('lang');"
        "document.getElementById('force-plot').removeAttribute('aria-label')"
    )
    assert {rule for rule, *_ in browser.accessibility_faults()} == {
        'html-has-lang',
        'role-img-alt',
    }


def test_changes_are_marked_and_the_effort_has_a_trace_of_its_own(graph, page, browser):
    """A muscle that tires, a sudden change, and a patient who pulls."""
    other = graph.add(lambda **options: Node('other', **options))
    estimates = other.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
    forces = other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    begun_ns, sent, axis = 10**18, [0], (0.0, 0.0, 1.0)

    def send():
        for _ in range(50):
            sent[0] += 1
            stamp_ns = begun_ns + sent[0] * 1_000_000
            forces.publish(messages.force_message(stamp_ns, 2.0, axis, MESSAGE_TYPES))
        message = MuscleEstimate(
            estimator='tracking',
            unit='N',
            disturbance=1.0 + 0.01 * sent[0] % 1.0,
            disturbance_deviation=0.1,
            rate_names=['force_percent'],
            rate=[-2.5],
            rate_lower=[-3.0],
            rate_upper=[-2.0],
        )
        message.header = messages.header_message(stamp_ns, '', MESSAGE_TYPES)
        if sent[0] > 1000:
            message.changes, message.change_kinds = 1, ['gain']
            message.change_ago = [(stamp_ns - begun_ns) * 1e-9 - 0.75]
        estimates.publish(message)

    graph.wait_for(
        lambda: estimates.get_subscription_count() * forces.get_subscription_count() > 0
    )
    browser.open(page.server.url)
    browser.wait_for("document.getElementById('connection').textContent === 'connected'")
    assert browser.evaluate("document.getElementById('effort').hidden")
    timer = other.create_timer(0.05, send)
    graph.wait_for(lambda: browser.evaluate('plots.effort.time.length > 5'), 60.0)
    assert not browser.evaluate("document.getElementById('effort').hidden")
    time_s, lower, value, upper = browser.evaluate(
        '["time", "lower", "value", "upper"].map((name) => plots.effort[name])'
    )
    assert time_s == sorted(set(time_s))
    half = [(c - a) / 2 for a, c in zip(lower, upper, strict=True)]
    # 95 % of a normal distribution lie within 1.96 standard deviations
    assert half == pytest.approx([0.196] * len(half))
    assert 1.0 <= min(value) <= max(value) <= 2.0
    graph.wait_for(lambda: browser.text('#change-list') == 'gain at 0.75 s', 60.0)
    assert browser.text('#rate-rows tr') == 'force_percent-2.5-3 to -2'
    width = "document.querySelector('#effort-plot canvas').getBoundingClientRect().width"
    assert browser.evaluate(width) > 500
    timer.cancel()
    assert browser.accessibility_faults() == []
    assert browser.complaints() == []


NASTY = '<img src=x onerror=alert(1)></td><script>document.title="taken"</script>\u202e'


def hostile(graph):
    """Publish an estimate and a status with the names of somebody who means harm."""
    other = graph.add(lambda **options: Node('other', **options))
    estimate = MuscleEstimate(
        estimator=NASTY,
        doubts=[NASTY],
        reasons=[NASTY, 'x' * 5000],
        fault_names=[NASTY],
        fault_counts=[2**64 - 1],
        output_error=float('nan'),
        rate_names=[NASTY],
        rate=[float('inf')],
        rate_lower=[float('-inf')],
        rate_upper=[float('nan')],
        change_kinds=[NASTY],
        change_ago=[float('nan')],
        changes=1,
        physiology_names=[NASTY],
        physiology=[float('nan')],
    )
    status = DriverStatus(
        state=77,
        reason=NASTY,
        operator_id=NASTY,
        device=NASTY,
        schedule=NASTY,
        button_names=[NASTY],
        button_states=[9],
        time_left=float('nan'),
    )
    estimates = other.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
    states = other.create_publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    forces = other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    axis = (0.0, 0.0, 1.0)
    sent = [0]

    def send():
        for _ in range(50):
            sent[0] += 1
            value = float('nan') if sent[0] % 7 == 0 else float(sent[0] % 50)
            stamp_ns = 10**18 + sent[0] * 1_000_000
            forces.publish(messages.force_message(stamp_ns, value, axis, MESSAGE_TYPES, NASTY))
        estimates.publish(estimate)
        states.publish(status)

    graph.wait_for(
        lambda: estimates.get_subscription_count() * forces.get_subscription_count() > 0
    )
    for _ in range(20):
        send()
    node_timer = other.create_timer(0.05, send)
    graph.wait_for(lambda: sent[0] > 1500)
    return node_timer


def test_hostile_names_are_text(graph, page, browser):
    hostile(graph)
    browser.open(page.server.url)
    browser.wait_for("document.querySelectorAll('#fault-rows tr').length === 1")
    browser.wait_for("document.getElementById('state').textContent.includes('onerror')")
    assert browser.evaluate('document.title') == 'Live: /'
    assert browser.evaluate("document.querySelectorAll('img, td script, li script').length") == 0
    assert '<img src=x' in browser.text('#doubt-list')
    assert '\u202e' not in browser.text('#doubt-list')
    assert browser.text('#fault-rows td') == str(2**64 - 1) or browser.text('#fault-rows td')
    assert browser.evaluate('document.documentElement.scrollWidth - innerWidth') <= 0
    assert browser.complaints() == []


def test_the_stop_of_the_page_asks_for_the_token(graph, page, browser):
    browser.open(page.server.url)
    browser.wait_for("!document.getElementById('unlock').hidden")
    assert browser.evaluate("document.getElementById('stop').hidden")

    def enter(token):
        browser.evaluate(
            f"document.getElementById('token').value = {json.dumps(token)};"
            "document.querySelector('#unlock button').click()"
        )

    enter('wrong-horse-battery')
    browser.evaluate("document.getElementById('stop').click()")
    browser.wait_for("document.getElementById('stopped').textContent.includes('NOT STOPPED')")
    # a new connection tells the state of the stop once more, which is no answer to this
    for stream in list(page.server.browsers):
        page.server.call(stream.close)
    browser.wait_for("document.body.classList.contains('lost')")
    browser.wait_for("!document.body.classList.contains('lost')")
    # the first frame, which has it, is drawn
    streams = page.server.browsers
    graph.wait_for(lambda: any(one.ready and one.cursor.topics for one in streams))
    browser.evaluate("document.getElementById('topic-rows').replaceChildren()")
    # ... and all texts are written anew
    browser.wait_for("document.getElementById('topic-rows').childElementCount > 0")
    assert 'NOT STOPPED' in browser.text('#stopped')
    browser.wait_for("!document.getElementById('unlock').hidden")
    assert page.stop._button is None
    enter(TOKEN)
    browser.evaluate("document.getElementById('stop').click()")
    graph.wait_for(lambda: page.stop._button is not None)
    browser.wait_for("!document.getElementById('let-go').hidden")
    browser.evaluate("document.getElementById('let-go').click()")
    graph.wait_for(lambda: page.stop._button is None)


def page_process(domain, *arguments):
    """`rpms live` as a process, and the address that it prints."""
    process = subprocess.Popen(
        [*RPMS, 'live', *arguments],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    return process, process.stdout.readline().strip()


def test_a_page_that_was_killed_says_so_and_comes_back(domain, browser):
    process, url = page_process(domain, '--namespace', '/left', '--port', '0')
    port = url.rstrip('/').rpartition(':')[2]
    browser.open(url)
    browser.wait_for("document.getElementById('connection').textContent === 'connected'")
    process.kill()
    process.communicate()
    browser.wait_for("document.body.classList.contains('lost')")
    assert 'what is shown is old' in browser.text('#connection')
    again, _ = page_process(domain, '--namespace', '/left', '--port', port)
    browser.wait_for("document.getElementById('connection').textContent === 'connected'")
    assert browser.text('#title') == '/left'
    again.terminate()
    assert (again.communicate()[1].count('Traceback'), again.returncode) == (0, 0)


def test_the_command_finds_the_namespace_and_names_several(graph, domain):
    def sensor(namespace):
        node = graph.add(lambda **options: Node('sensor', namespace=namespace, **options))
        return node.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)

    sensor('/left')
    process, url = page_process(domain, '--port', '0', '--stop')
    assert url.startswith('http://127.0.0.1:')
    assert len(url.partition('#token=')[2]) == 32
    process.terminate()
    errors = process.communicate()[1]
    assert 'shows /left' in errors
    assert url.partition('#token=')[2] not in errors
    sensor('/right')
    process, _ = page_process(domain, '--port', '0')
    assert process.communicate()[1].endswith(
        'expected one namespace with a session, got /left, /right; choose one with --namespace\n'
    )
    assert process.returncode == 2


def test_a_port_that_is_taken_is_one_line_and_exit_code_two(domain, page):
    process, _ = page_process(domain, '--namespace', '/', '--port', str(page.server.port))
    errors = process.communicate()[1].splitlines()
    assert process.returncode == 2
    assert errors[-1].startswith(f'error: expected to listen on port {page.server.port} of')
    assert 'Traceback' not in ''.join(errors)
