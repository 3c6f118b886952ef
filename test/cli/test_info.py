# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms info: facts as text and as JSON."""

import os
from collections.abc import Callable
from pathlib import Path

Rpms = Callable[..., tuple[int, str, str]]


def test_text(rpms: Rpms, short_session: Path) -> None:
    code, out, err = rpms('info', short_session)
    assert (code, err) == (0, '')
    lines = out.splitlines()
    assert lines[0] == f'{short_session}  (mcap)'
    assert lines[2].split() == [
        '/force', 'geometry_msgs/msg/WrenchStamped', '10000', '9.999', 's', '1000.0', 'Hz',
    ]  # fmt: skip
    assert lines[3].split() == [
        '/pulses',
        'rpms_msgs/msg/Pulse',
        '200',
        '9.950',
        's',
        '20.0',
        'Hz',
    ]
    assert '  schedule: uniform_random' in lines
    assert max(map(len, lines)) <= 100


def test_what_is_wrong_is_said_and_the_exit_code_tells(
    rpms: Rpms, short_session: Path, tmp_path: Path
) -> None:
    path = tmp_path / 'cut.mcap'
    path.write_bytes((short_session / 'short_0.mcap').read_bytes())
    os.truncate(path, 100_000)
    code, out, _ = rpms('info', path)
    assert code == 1
    assert '  warning: cut.mcap has no end: ' in out
