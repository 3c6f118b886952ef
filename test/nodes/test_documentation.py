# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pages and files hold what the code says: parameters, topics, code that runs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'nodes.md').read_text()


def test_files_of_parameters_and_schema_are_what_tools_document_writes() -> None:
    tool = [sys.executable, str(ROOT / 'tools' / 'document'), '--check']
    done = subprocess.run(tool, capture_output=True, text=True, timeout=250, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.long
@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGTERM])
def test_the_code_on_the_page_runs_until_a_signal(domain: int, sent: signal.Signals) -> None:
    code = PAGE.split('```python\n')[1].split('```')[0]
    told = code.replace('while not', 'print("running", flush=True)\nwhile not')
    assert told != code
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    with subprocess.Popen(
        [sys.executable, '-c', told],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            # the first run on a machine compiles for up to a minute before
            assert process.stdout.readline() == 'running\n'
            time.sleep(2.0)
            assert process.poll() is None
            process.send_signal(sent)
            _, err = process.communicate(timeout=120)
        finally:
            process.kill()
    assert 'Traceback' not in err
    assert process.returncode == 0
