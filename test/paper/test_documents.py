# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The documents name things that exist."""

import dataclasses
import importlib
import inspect
import re
from pathlib import Path

import pytest

from rpms_ros.identification import DistortedSineBasis
from rpms_ros.muscle import IntensityRecruitment, RecruitmentParameters

ROOT = Path(__file__).resolve().parents[2]
ROW = re.compile(r'^\| [^|]+ \| `(?P<name>[\w.]+)(?:\((?P<argument>\w+)\))?` \| [^|]+ \| ', re.M)
GLOSSARY = (ROOT / 'docs/glossary.md').read_text(encoding='utf-8')
TEST = re.compile(r'`(test/[\w/]+\.py)::(\w+)`')
MODEL = (ROOT / 'docs/model.md').read_text(encoding='utf-8')


def resolve(name) -> object:
    """Return what a dotted name below the package stands for; a field for one of a class."""
    module, *attributes = name.split('.')
    found: object = importlib.import_module(f'rpms_ros.{module}')
    for attribute in attributes:
        fields = getattr(found, '__dataclass_fields__', {})
        found = fields[attribute] if attribute in fields else getattr(found, attribute)
    return found


@pytest.mark.parametrize(('name', 'argument'), ROW.findall(GLOSSARY))
def test_names_of_the_glossary_exist(name, argument):
    found = resolve(name)
    assert not argument or argument in inspect.signature(found).parameters  # type: ignore[arg-type]


def test_every_row_of_the_glossary_is_understood():
    rows = [line for line in GLOSSARY.splitlines() if line.startswith('| ') and '`' in line]
    assert len(ROW.findall(GLOSSARY)) == len(rows) > 40


@pytest.mark.parametrize(
    ('owner', 'names'),
    [
        (
            'muscle.IntensityRecruitment',
            [field.name for field in dataclasses.fields(IntensityRecruitment)],
        ),
        ('muscle.RecruitmentParameters', list(RecruitmentParameters._fields)),
        (
            'identification.DistortedSineBasis',
            [field.name for field in dataclasses.fields(DistortedSineBasis)],
        ),
    ],
)
def test_parameters_with_a_letter_are_in_the_glossary(owner, names):
    listed = {name for name, _ in ROW.findall(GLOSSARY)}
    assert {f'{owner}.{name}' for name in names} <= listed


def test_every_number_of_the_model_has_a_test():
    references = TEST.findall(MODEL)
    assert len(references) > 25
    for path, function in references:
        assert f'def {function}(' in (ROOT / path).read_text(encoding='utf-8'), function
