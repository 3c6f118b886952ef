# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms demo --live` as a stranger starts it: a page that answers, and nothing to press."""

import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

RPMS = [sys.executable, '-c', 'import sys; from rpms_ros.cli import main; sys.exit(main())']
# a machine under load may have to compile first
PATIENCE = 180.0


@pytest.fixture
def demo(tmp_path, unused_port):
    """The demo with its page, and the address that it printed."""
    process = subprocess.Popen(
        [*RPMS, 'demo', '--live', str(unused_port), '--out', str(tmp_path / 'demo')],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    said = [process.stdout.readline() for _ in range(2)]
    yield process, said[1].strip().rpartition(' ')[2]
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)


def answers(url):
    """Whether somebody serves there."""
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


@pytest.mark.long
def test_the_page_of_a_demo_answers_when_it_is_printed_and_only_shows(demo):
    process, url = demo
    assert answers(url)
    with pytest.raises(urllib.error.HTTPError, match='403'):
        urllib.request.urlopen(urllib.request.Request(f'{url}stop', method='POST'), timeout=60)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert 'Traceback' not in errors
