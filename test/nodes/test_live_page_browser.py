# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The live page with the real nodes in a real browser without a window."""

import json

import pytest
from geometry_msgs.msg import WrenchStamped

from rpms_msgs.msg import DriverStatus, MuscleEstimate
from rpms_ros import messages
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.live_page import UNCONFIRMED

pytestmark = pytest.mark.long

# of `page`
TOKEN = 'correct-horse-battery'


@pytest.fixture
def browser(beside, tmp_path):
    """A browser on a screen of 1100 px."""
    with beside('devtools').Browser(tmp_path / 'profile') as running:
        running.screen(1100)
        yield running


def test_the_stop_button_in_the_browser_stops_a_real_driver(graph, page, driven, browser):
    browser.open(f'{page.server.url}#token={TOKEN}')
    graph.wait_for(lambda: driven.controller.delivered >= 5, 60.0)
    graph.wait_for(lambda: browser.text('#state').startswith('running'))
    browser.evaluate("document.getElementById('stop').click()")
    graph.wait_for(lambda: browser.text('#state').startswith('stopped'))
    delivered = driven.controller.delivered
    graph.wait_for(lambda: 'the driver confirms it' in browser.text('#stopped'))
    browser.wait_for("!document.getElementById('let-go').hidden")
    browser.evaluate("document.getElementById('let-go').click()")
    graph.wait_for(lambda: page.stop._button is None)
    # let go of here, stopped there; nobody let the driver say so while the browser was waited for
    graph.wait_for(lambda: browser.text('#state').startswith('stopped'))
    assert driven.controller.delivered == delivered


IN_SIGHT = """(() => {
  const one = document.getElementById('%s'), place = one.getBoundingClientRect();
  const there = document.elementFromPoint(place.x + 5, place.y + place.height / 2);
  return place.top >= 0 && place.bottom <= innerHeight && one.contains(there);
})()"""
DRAWN = """(() => { const c = document.querySelector('#force-plot canvas');
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let n = 0; for (let i = 3; i < d.length; i += 4) { n += d[i] > 200; } return n; })()"""
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
    assert browser.evaluate(DRAWN) > 500
    rows = browser.evaluate(
        "[...document.querySelectorAll('#parameter-rows tr')].map((row) => row.textContent)"
    )
    assert any(row.startswith('threshold u_thr') for row in rows)
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
            assert browser.evaluate('document.documentElement.scrollWidth - innerWidth') <= 0
            assert browser.accessibility_faults() == [], (dark, width)
            # at the end of the page too, the state and the stop are in sight
            browser.evaluate('scrollTo(0, document.documentElement.scrollHeight)')
            browser.wait_for('scrollY > 500')
            for part in ('state', 'stop'):
                assert browser.evaluate(IN_SIGHT % part), (part, width)
            assert browser.beyond_the_keyboard() == [], (dark, width)
    assert browser.evaluate(UNCAPTIONED) == 0
    assert browser.evaluate('document.documentElement.lang') == 'en'
    browser.to_the_top()
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
    browser.evaluate("document.getElementById('hold').tabIndex = -1")
    (beyond,) = browser.beyond_the_keyboard()
    assert beyond.startswith('<button type="button" id="hold"')


NASTY = '<img src=x onerror=alert(1)></td><script>document.title="taken"</script>\u202e'


def hostile(graph):
    """Publish an estimate and a status with the names of somebody who means harm."""
    estimate = MuscleEstimate(
        estimator=NASTY,
        reasons=[NASTY, 'x' * 5000],
        fault_counts=[2**64 - 1],
        output_error=float('nan'),
        changes=1,
    )
    for name in ('doubts', 'fault_names', 'rate_names', 'change_kinds', 'physiology_names'):
        setattr(estimate, name, [NASTY])
    for name in ('rate', 'rate_lower', 'rate_upper', 'change_ago', 'physiology'):
        setattr(estimate, name, [float('nan')])
    estimate.rate, estimate.rate_lower = [float('inf')], [float('-inf')]
    status = DriverStatus(
        state=77, button_names=[NASTY], button_states=[9], time_left=float('nan')
    )
    for name in ('reason', 'operator_id', 'device', 'schedule'):
        setattr(status, name, NASTY)
    estimates = graph.publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
    states = graph.publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    forces = graph.publisher(WrenchStamped, topics.FORCE, qos.FORCE)
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

    for _ in range(20):
        send()
    timer = graph.node('other').create_timer(0.05, send)
    graph.wait_for(lambda: sent[0] > 1500)
    return timer


def test_hostile_names_are_text(graph, page, browser):
    timer = hostile(graph)
    browser.open(page.server.url)
    browser.wait_for("document.querySelectorAll('#fault-rows tr').length === 1")
    browser.wait_for("!document.getElementById('doubtful').hidden")
    # the page calls the driver silent while nobody lets it publish
    graph.wait_for(lambda: 'onerror' in browser.text('#state'))
    assert browser.evaluate('document.title') == 'stimulated muscle, live'
    assert browser.evaluate("document.querySelectorAll('img, td script, li script').length") == 0
    assert '<img src=x' in browser.text('#doubt-list')
    assert '\u202e' not in browser.text('#doubt-list')
    # 2^64 - 1 as a number of JavaScript
    assert browser.text('#fault-rows td') == '18446744073709552000'
    assert browser.evaluate('document.documentElement.scrollWidth - innerWidth') <= 0
    # a state is not taken for that of now when it is old
    timer.cancel()
    graph.wait_for(lambda: browser.text('#state').startswith('driver silent for '))
    assert browser.text('#state').endswith('; last state: state 77')
    # nor while something comes that cannot be read
    garbled = graph.publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    graph.node('older').create_timer(0.05, lambda: garbled.publish(bytes((0, 1, 0, 0, 7))))
    graph.wait_for(lambda: browser.text('#state').startswith('driver not shown: '))
    assert browser.complaints() == []


# it may be connected again before anybody looks
NOTE_LOSS = """window.lost = false;
new MutationObserver(() => { lost ||= document.body.classList.contains('lost'); })
  .observe(document.body, { attributes: true });"""


def test_the_stop_of_the_page_asks_for_the_token_and_hides_no_alarm(graph, page, browser):
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
    browser.evaluate(NOTE_LOSS)
    for stream in list(page.server.browsers):
        page.server.call(stream.close)
    browser.wait_for("lost && !document.body.classList.contains('lost')")
    # the first frame, which has it, is drawn
    streams = page.server.browsers
    graph.wait_for(lambda: any(one.ready and one.cursor.changes for one in streams))
    browser.evaluate("document.getElementById('topic-rows').replaceChildren()")
    # ... and all texts are written anew
    browser.wait_for("document.getElementById('topic-rows').childElementCount > 0")
    assert 'NOT STOPPED' in browser.text('#stopped')
    browser.wait_for("!document.getElementById('unlock').hidden")
    assert page.stop._button is None
    enter(TOKEN)
    # a second press hides no alarm
    for _ in range(2):
        browser.evaluate("document.getElementById('stop').click()")
        graph.wait_for(lambda: browser.text('#stopped') == UNCONFIRMED)
    assert page.stop._button is not None
    browser.wait_for("!document.getElementById('let-go').hidden")
    browser.evaluate("document.getElementById('let-go').click()")
    graph.wait_for(lambda: page.stop._button is None)
    # a program that hangs takes the request and does not answer
    browser.evaluate('window.fetch = () => new Promise(() => {}), 1')
    browser.evaluate("document.getElementById('stop').click()")
    browser.wait_for("document.getElementById('stopped').textContent.includes('NOT STOPPED')")


def test_a_page_that_was_killed_says_so_and_comes_back(python, browser, unused_port):
    live = ('-m', 'rpms_ros.cli', 'live', '--namespace', '/left', '--port', str(unused_port))
    process = python(*live)
    browser.open(process.stdout.readline().strip())
    browser.wait_for("document.getElementById('connection').textContent === 'connected'")
    process.kill()
    process.communicate()
    browser.wait_for("document.body.classList.contains('lost')")
    assert 'what is shown is old' in browser.text('#connection')
    for dark in (False, True):
        browser.screen(1100, dark=dark)
        assert browser.accessibility_faults() == [], dark
    again = python(*live)
    browser.wait_for("document.getElementById('connection').textContent === 'connected'")
    browser.wait_for("document.getElementById('title').textContent === 'left'")
    again.terminate()
    assert (again.communicate()[1].count('Traceback'), again.returncode) == (0, 0)
