# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of Foxglove and PlotJuggler: valid, and every topic and field exists in the messages."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from geometry_msgs.msg import WrenchStamped

from rpms_msgs.msg import DriverStatus, MuscleEstimate, Pulse
from rpms_ros.nodes.common import topics

CONFIG = Path(__file__).resolve().parents[2] / 'config'
TYPES = {
    topics.PULSES: Pulse,
    topics.PULSES_COMMANDED: Pulse,
    topics.FORCE: WrenchStamped,
    topics.DISTURBANCE: WrenchStamped,
    topics.ESTIMATE: MuscleEstimate,
    topics.DRIVER_STATUS: DriverStatus,
}
NUMBER = re.compile(r'(double|float|u?int\d+)')


def kind_of(topic: str, path: list[str]) -> str:
    """Type of a field, an element of an array by its element."""
    message: Any = TYPES[topic]()
    kind = ''
    for part in path:
        name, _, rest = part.partition('[')
        kind = message.get_fields_and_field_types()[name]
        message = getattr(message, name)
        if rest:
            assert kind.startswith('sequence<'), f'{name} is no array'
            assert re.fullmatch(r'(\d+|:)\]', rest)
            kind = kind.removeprefix('sequence<').removesuffix('>')
    return kind


def foxglove_number(value: str) -> None:
    """Assert that a message path of Foxglove leads to a number."""
    assert value.startswith('/')
    topic, *fields = value[1:].split('.')
    assert NUMBER.fullmatch(kind_of(topic, fields)), value


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    document = json.loads((CONFIG / 'foxglove_layout.json').read_text())
    assert isinstance(document, dict)
    return document


def test_foxglove_shows_numbers_that_exist(foxglove: dict[str, Any]) -> None:
    shown = set()
    for name, panel in foxglove['configById'].items():
        assert panel['foxglovePanelTitle']
        if name.startswith('RawMessages!'):
            assert panel['topicPath'].lstrip('/') in TYPES
            continue
        assert panel['paths']
        along = panel.get('xAxisPath')
        assert (along is not None) == (panel['xAxisVal'] == 'currentCustom')
        if along:
            foxglove_number(along['value'])
        for path in panel['paths']:
            foxglove_number(path['value'])
            assert path['timestampMethod'] == 'headerStamp'
            assert path['enabled']
            assert path['value'].endswith('[:]') == bool(along)
            shown.add(re.split(r'[./]', path['value'])[1])
    assert shown == set(TYPES)


@pytest.fixture(scope='module')
def plotjuggler() -> ET.Element:
    return ET.parse(CONFIG / 'plotjuggler_layout.xml').getroot()


def test_plotjuggler_shows_numbers_that_exist(plotjuggler: ET.Element) -> None:
    names = [curve.get('name', '') for curve in plotjuggler.iter('curve')]
    assert len(set(names)) == len(names)
    for name in names:
        _, topic, *fields = name.split('/')
        assert NUMBER.fullmatch(kind_of(topic, fields)), name
    assert {name.split('/')[1] for name in names} == set(TYPES)
