# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Layouts for a namespace, an axis and a quantity."""

import json
import os
import re
import sys
from pathlib import Path

import pytest

from rpms_ros.cli import main
from rpms_ros.cli.live import LayoutError, layout

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.environ.get('AMENT_PREFIX_PATH', sys.prefix))


@pytest.mark.parametrize(('program', 'name'), [
    ('foxglove', 'foxglove_layout.json'), ('plotjuggler', 'plotjuggler_layout.xml'),
])  # fmt: skip
def test_without_a_namespace_it_is_the_file(program: str, name: str) -> None:
    given = (ROOT / 'config' / name).read_text()
    if program == 'foxglove':
        assert json.loads(layout(program)) == json.loads(given)
    else:
        assert layout(program) == given


@pytest.mark.parametrize('program', ['foxglove', 'plotjuggler'])
def test_every_topic_moves_and_titles_say_what_is_measured(program: str) -> None:
    text = layout(program, 'ward/left_leg', '-x', 'torque')
    paths = re.findall(r'"(/[^"]+)"', text)
    assert len(paths) >= 15
    assert all(path.startswith('/ward/left_leg/') for path in paths)
    separator = '.' if program == 'foxglove' else '/'
    assert f'/ward/left_leg/force{separator}wrench{separator}torque{separator}x' in paths
    assert ('Torque / N m' if program == 'foxglove' else 'torque [N m]') in text
    assert not re.search(r'wrench.force', text)


def test_the_command_writes_and_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'left.json'
    assert main(['layout', 'foxglove', '--namespace', 'left', '--out', str(path)]) == 0
    assert capsys.readouterr().out == f'{path}\n'
    assert path.read_text() == layout('foxglove', 'left')
    assert main(['layout', 'plotjuggler']) == 0
    assert capsys.readouterr().out == layout('plotjuggler')
    assert main(['layout', 'foxglove', '--out', str(tmp_path / 'no' / 'such')]) == 2
    assert 'expected a file to write, got' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('rviz',), "expected program foxglove, plotjuggler, got 'rviz'"),
        (
            ('foxglove', 'left leg'),
            'expected a namespace of letters, .* got .left leg',
        ),
        (('foxglove', '<curve>'), 'expected a namespace'),
        (('foxglove', '', 'up'), "expected axis x, y, .* got 'up'"),
        (('foxglove', '', 'z', 'work'), "expected quantity force, torque, got 'work'"),
    ],
)
def test_what_is_none_is_refused(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(LayoutError, match=message):
        layout(*arguments)


def test_a_layout_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', '/nowhere')
    monkeypatch.setattr(sys, 'prefix', '/nowhere')
    with pytest.raises(LayoutError, match='expected foxglove_layout'):
        layout('foxglove')
