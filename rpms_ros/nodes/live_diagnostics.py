# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How a live page is: what it hears, what it cannot show, and how many look."""

from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.live import session as shown
from rpms_ros.live.heard import NEVER
from rpms_ros.live.heard import SILENT
from rpms_ros.live.session import LiveSession
from rpms_ros.nodes.diagnostics import Health


def live_health(session: LiveSession, browsers: int, now: float) -> Health:
    """Return how a live page is at `now` [s], of a steady clock.

    Stale while no force comes, a warning while a stop that was pressed is not confirmed or a topic
    has messages that cannot be shown, ok otherwise.
    """
    level, text = DiagnosticStatus.OK, 'showing'
    refused = [topic.name for topic in session.topics.values() if topic.refused]
    if session.topics[shown.FORCE].state(now) in (NEVER, SILENT):
        level, text = DiagnosticStatus.STALE, 'no force'
    if refused:
        level, text = DiagnosticStatus.WARN, f'cannot show all of {", ".join(refused)}'
    if session.stop_pressed and not session.confirms_stop(now):
        level, text = DiagnosticStatus.WARN, 'stop pressed, not confirmed by the driver'
    figures: dict[str, object] = {'browsers': browsers, 'driver': session.state or 'not heard'}
    for topic in session.topics.values():
        figures[f'{topic.name} [Hz]'] = f'{topic.rate(now):.1f}'
    return Health(text, level, figures)
