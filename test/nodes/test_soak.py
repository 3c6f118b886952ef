# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A few seconds of bench/soak.py: all nodes, faults and restarts, and nothing is lost."""

import sys
from pathlib import Path

import pytest

from rpms_ros.nodes import operator_console

BENCH = Path(__file__).resolve().parents[2] / 'bench'
SECONDS = 10.0


@pytest.mark.long
def test_nothing_is_lost_between_nodes_and_recordings(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))
    # the bench sets it for its console
    monkeypatch.setattr(operator_console, 'KEY_DELAY_S', operator_console.KEY_DELAY_S)
    soak = __import__('soak')
    counts, injected, named, memory = soak.soak(
        tmp_path, SECONDS, rate=200.0, seed=1, restart_every_s=4.0, fault_share=0.6
    )
    assert soak.failures(counts) == []
    for name in ('force recorded', 'pulses recorded', 'estimates made again off line'):
        assert counts[name] > 0, name
    assert counts['restarts of identifier and recorder'] == 2
    assert counts['restarts of plant'] > 0
    assert sum(injected.values()) > SECONDS / 2
    assert sum(named.values()) > 0
    assert len(memory) > 0
    # The bench is no module of the package: what is loaded from it must not stay.
    for name in ('soak', 'soak_clinic', 'soak_laboratory'):
        sys.modules.pop(name, None)
