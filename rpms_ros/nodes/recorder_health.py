# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Health of a recorder: what was recorded, what is missing, and how much space is left."""

import shutil
from collections.abc import Mapping
from collections.abc import Sequence
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.nodes.diagnostics import Health

LEAST_ROOM = 1_000_000_000
"""Free bytes below which a session of an hour may not fit on the disk."""


def recorder_health(
    path: Path, counts: Mapping[str, int], missing: Sequence[str], lost: Mapping[str, int]
) -> Health:
    """Return the health of a recorder.

    Parameters
    ----------
    path : Path
        Folder of the recording.
    counts : mapping of str to int
        Messages so far, by topic.
    missing : sequence of str
        Topics that are published and not recorded.
    lost : mapping of str to int
        Messages that were lost, by topic.
    """
    free = shutil.disk_usage(path).free
    total = sum(counts.values())
    level, said = DiagnosticStatus.OK, 'recording' if total else 'recording; no message yet'
    faults = [f'not recorded: {", ".join(missing)}'] if missing else []
    faults += [f'{count} messages of {name} lost' for name, count in lost.items()]
    if free < LEAST_ROOM:
        faults.append(f'{free / 1e6:.0f} MB are left on the disk')
    if faults:
        level, said = DiagnosticStatus.WARN, '; '.join(faults)
    figures = {
        'path': path.resolve(),
        'messages': total,
        'free on the disk [MB]': f'{free / 1e6:.0f}',
        **{f'messages of {name}': count for name, count in counts.items()},
    }
    return Health(said, level, figures)
