# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled functions of other sources are not used: an edit of what they call counts."""

import os
import subprocess
import sys

import numba

from rpms_ros.compiled_cache import key_of, use_cache_of

CALLED = 'from numba import njit\n\n@njit(cache=True)\ndef called(x):\n    return x + {}\n'
CALLER = """from numba import njit

from mathematics.called import called

@njit(cache=True)
def caller(x):
    return 10 * called(x)
"""
SCRIPT = """
import sys
from pathlib import Path
from rpms_ros import compiled_cache
compiled_cache.use_cache_of(Path(sys.argv[1]))
from mathematics.caller import caller
print(caller(1), sum(caller.stats.cache_hits.values()))
"""


def result(package):
    """Return what the compiled function says, and how often it came out of the cache."""
    environment = {**os.environ, 'PYTHONPATH': str(package.parent)}
    # Python tells sources apart by second and length alone
    environment['PYTHONDONTWRITEBYTECODE'] = '1'
    environment['NUMBA_CACHE_DIR'] = str(package.parent / 'cache')
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT, str(package)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=250,
    )
    return [int(word) for word in done.stdout.split()]


def test_old_mathematics_do_not_survive_an_edit(tmp_path):
    """Of a package whose one function calls another one's."""
    package = tmp_path / 'mathematics'
    package.mkdir()
    (package / '__init__.py').write_text('')
    (package / 'caller.py').write_text(CALLER)
    (package / 'called.py').write_text(CALLED.format(1))
    assert result(package) == [20, 0]
    assert result(package) == [20, 1]
    (package / 'called.py').write_text(CALLED.format(2))
    assert result(package) == [30, 0]
    assert result(package) == [30, 1]


def test_the_key_is_that_of_compiled_sources_only(tmp_path):
    (tmp_path / 'plain.py').write_text('x = 1\n')
    (tmp_path / 'called.py').write_text(CALLED.format(1))
    key = key_of(tmp_path)
    (tmp_path / 'plain.py').write_text('x = 2\n')
    assert key_of(tmp_path) == key
    for remark in (
        '# why\n',
        'r"""What \\it does."""\n',
        '"""Return ``x``.\n\n    return 7\n"""\n',
    ):
        (tmp_path / 'called.py').write_text(remark + CALLED.format(1))
        assert key_of(tmp_path) == key
    # a text that is a value counts
    for code in (CALLED.format(2), 'TEXT = """one\n"""\n' + CALLED.format(1)):
        (tmp_path / 'called.py').write_text(code)
        assert key_of(tmp_path) != key


def test_what_another_process_takes_away_is_not_missed(tmp_path, monkeypatch):
    """Nodes that start at once after an edit prune the same folder: one of them failed."""
    cache, scandir = tmp_path / '__pycache__', os.scandir
    (cache / 'rpms_ros-going').mkdir(parents=True)
    (cache / 'rpms_ros-gone').symlink_to(tmp_path / 'gone')
    (tmp_path / 'called.py').write_text(CALLED.format(1))

    def taken_away(path='.'):
        if 'rpms_ros-going' in str(path):
            raise FileNotFoundError(path)
        return scandir(path)

    monkeypatch.setattr(os, 'scandir', taken_away)
    monkeypatch.setenv('NUMBA_CACHE_DIR', '')
    monkeypatch.setattr(numba.config, 'CACHE_DIR', '')
    use_cache_of(tmp_path)
    assert os.environ['NUMBA_CACHE_DIR'] == str(cache / key_of(tmp_path))
