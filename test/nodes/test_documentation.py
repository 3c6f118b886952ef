"""docs/nodes.md holds the tables that the dataclasses and the list of faults give."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rpms_ros.identification.faults import MEANING
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import descriptions
from rpms_ros.nodes.parameters import type_of
from rpms_ros.nodes.plant_parameters import PlantParameters
from rpms_ros.nodes.recorder import RecorderParameters

PAGE = (Path(__file__).resolve().parents[2] / 'docs' / 'nodes.md').read_text()


def table(settings: type[NodeParameters]) -> str:
    default = settings()
    lines = ['| parameter | type | default | allowed | meaning |', '|---|---|---|---|---|']
    for name, description in descriptions(settings).items():
        kind = type_of(settings, name).name.lower().replace('_', ' ')
        value = getattr(default, name)
        shown = ', '.join(value) if isinstance(value, tuple) else repr(value)
        cells = (f'`{name}`', kind, f'`{shown}`', description.conditions(), description.doc)
        lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines)


@pytest.mark.parametrize('settings', [PlantParameters, IdentifierParameters, RecorderParameters])
def test_the_page_holds_the_table_of_parameters(settings: type[NodeParameters]) -> None:
    assert table(settings) in PAGE


def test_the_page_names_every_fault_with_its_meaning() -> None:
    for name, meaning in MEANING.items():
        assert f'| `{name}` | {meaning} |' in PAGE


PROFILES = {
    topics.PULSES: qos.PULSES,
    topics.FORCE: qos.FORCE,
    topics.ESTIMATE: qos.ESTIMATE,
    topics.DRIVER_STATUS: qos.STATUS,
}


@pytest.mark.parametrize(('topic', 'profile'), PROFILES.items())
def test_the_page_names_the_depth_of_each_topic(topic: str, profile: qos.QoSProfile) -> None:
    (line,) = (line for line in PAGE.splitlines() if line.startswith(f'| `{topic}` | `'))
    durability = profile.durability.name.lower().replace('_', ' ')
    assert line.endswith(f'| reliable, {durability}, depth {profile.depth} |')


def test_the_code_on_the_page_runs(domain: int) -> None:
    (code,) = (part.split('```')[0] for part in PAGE.split('```python\n')[1:])
    briefly = code.replace('while rclpy.ok():', 'for _ in range(20):')
    assert briefly != code
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    command = [sys.executable, '-c', f'{briefly}\nrclpy.shutdown()']
    # The first run on a machine compiles for up to a minute.
    subprocess.run(command, env=environment, check=True, timeout=180)
