# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions for the tests of the commands."""

import json

import pytest

from rpms_ros.cli import main


@pytest.fixture
def rpms(capsys):
    """Run a command in this process; return its exit code, stdout and stderr."""

    def run(*arguments):
        code = main([str(argument) for argument in arguments])
        return (code, *capsys.readouterr())

    return run


@pytest.fixture(scope='session')
def short_session(tmp_path_factory):
    """Ten seconds of the paper's simulated identification."""
    path = tmp_path_factory.mktemp('sessions') / 'short'
    assert main(['simulate', '--out', str(path), '--duration', '10', '--quiet']) == 0
    return path


@pytest.fixture
def as_json(rpms):
    """Run a command that prints one JSON object; return it."""

    return lambda *arguments: json.loads(rpms(*arguments)[1])
