# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The walks of CONTRIBUTING.md name files, names and entry points that there are."""

import importlib
import re
from dataclasses import fields
from pathlib import Path

import pytest

from rpms_ros.identification import catalogue
from rpms_ros.identification.stream import sensor_checks
from rpms_ros.stimulation.devices import registry

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
WALKS = dict(re.findall(r'## (A new [^\n]+)\n(.*?)(?=\n## |\Z)', PAGE, re.DOTALL))
PLACE = re.compile(r'`((?:test|docs|rpms_ros|msg_defs|identification|tools)/[\w/.*]*\w)`')


@pytest.mark.parametrize('title', WALKS)
def test_every_file_is_there(title):
    for place in PLACE.findall(WALKS[title]):
        folder = ROOT / 'rpms_ros' if place.startswith('identification/') else ROOT
        assert list(folder.glob(place)), place


@pytest.mark.parametrize('title', WALKS)
def test_every_dotted_name_is_there(title):
    for name in re.findall(r'`(rpms_ros(?:\.\w+)+)`', WALKS[title]):
        if name in (catalogue.GROUP, sensor_checks.GROUP, registry.GROUP):
            continue
        module, _, member = name.rpartition('.')
        assert hasattr(importlib.import_module(module), member), name


def test_groups_and_options_are_named():
    estimator, monitor = WALKS['A new estimator'], WALKS['A new monitor']
    assert f'"{catalogue.GROUP}"' in estimator
    assert f'`{sensor_checks.GROUP}`' in monitor
    for field in fields(catalogue.EstimatorOptions):
        assert f'`{field.name}`' in estimator, field.name
