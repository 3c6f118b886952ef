# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""tools/skip_policy.py, run in pytests of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / 'tools'


def run(folder, source, *, strict=False):
    (folder / 'test_it.py').write_text(source)
    environment = {**os.environ, 'PYTHONPATH': str(TOOLS), 'RPMS_STRICT_SKIPS': str(int(strict))}
    environment['PYTEST_DISABLE_PLUGIN_AUTOLOAD'] = '1'  # quicker
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'skip_policy', '-p', 'no:cacheprovider']
    return subprocess.run(
        [*command, '--rootdir', str(folder), str(folder)],
        cwd=folder,
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )


SKIP = 'import pytest\ndef test_a(): pass\ndef test_b(): pytest.skip({reason!r})\n'
SKIP_MODULE = 'import pytest\npytest.skip({reason!r}, allow_module_level=True)\n'
MISSING = ('RPMS_RECORDINGS: no such folder', 'RPMS_BROWSER: no browser of chromium')


@pytest.mark.parametrize('source', [SKIP, SKIP_MODULE], ids=['test', 'module'])
def test_an_unexpected_skip_fails_the_run(tmp_path, source):
    result = run(tmp_path, source.format(reason='do not feel like it'))
    assert result.returncode == pytest.ExitCode.TESTS_FAILED
    assert 'unexpected skips' in result.stdout
    assert 'do not feel like it' in result.stdout


@pytest.mark.parametrize('reason', MISSING)
def test_what_a_machine_lacks_may_be_skipped_but_in_a_strict_run(tmp_path, reason):
    for strict, ended in ((False, pytest.ExitCode.OK), (True, pytest.ExitCode.TESTS_FAILED)):
        assert run(tmp_path, SKIP.format(reason=reason), strict=strict).returncode == ended


@pytest.mark.parametrize(('target', 'left_out'), [('test', True), ('test-all', False)])
def test_make_test_leaves_out_what_is_long_and_test_all_nothing(target, left_out):
    command = ['make', '--dry-run', '--no-print-directory', '-C', str(TOOLS.parent), target]
    shown = subprocess.run(command, text=True, capture_output=True, check=True).stdout
    assert '-m pytest -p skip_policy' in shown
    assert ("-m 'not long'" in shown) == left_out
