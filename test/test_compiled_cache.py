# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled functions of other sources are not used: an edit of what they call counts."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rpms_ros.compiled_cache import key_of

ROOT = Path(__file__).resolve().parents[1]
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


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose one function calls another one's."""
    package = tmp_path / 'mathematics'
    package.mkdir()
    (package / '__init__.py').write_text('')
    (package / 'caller.py').write_text(CALLER)
    (package / 'called.py').write_text(CALLED.format(1))
    return package


def result(package: Path) -> list[int]:
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


def test_old_mathematics_do_not_survive_an_edit(package: Path) -> None:
    assert result(package) == [20, 0]
    assert result(package) == [20, 1]
    (package / 'called.py').write_text(CALLED.format(2))
    assert result(package) == [30, 0]
    assert result(package) == [30, 1]


def test_the_key_is_that_of_compiled_sources_only(tmp_path: Path) -> None:
    (tmp_path / 'plain.py').write_text('x = 1\n')
    (tmp_path / 'called.py').write_text(CALLED.format(1))
    key = key_of(tmp_path)
    (tmp_path / 'plain.py').write_text('x = 2\n')
    assert key_of(tmp_path) == key
    (tmp_path / 'called.py').write_text(CALLED.format(2))
    assert key_of(tmp_path) != key


@pytest.mark.long
def test_remarks_compile_nothing_anew_elsewhere(package: Path) -> None:
    assert result(package) == [20, 0]
    remark = '    # added: "why\\n"\n    return'
    for before, after in [
        ('    return', remark),
        ('@njit', '# above\n@njit'),
        ('(x):\n', '(x):\n    """Return ``x`` and a "bit".\n\n    return 7\n    """\n'),
        ('from numba', 'r"""What \\it does."""\nfrom numba'),
    ]:
        text = (package / 'called.py').read_text()
        assert before in text
        (package / 'called.py').write_text(text.replace(before, after, 1))
        assert result(package) == [20, 1]
    # what stands behind a remark, and a text that is a value, count
    text = (package / 'called.py').read_text()
    (package / 'called.py').write_text(text.replace('+ 1', '+ 2'))
    assert result(package) == [30, 0]
    key = key_of(package)
    (package / 'called.py').write_text(f'TEXT = """one\n"""\n{text}')
    assert key_of(package) != key


def python(path: Path, *arguments: str) -> str:
    """Run Python with the package at a path, and its compiled functions in it."""
    environment = {name: text for name, text in os.environ.items() if name != 'NUMBA_CACHE_DIR'}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=path,
        env={**environment, 'PYTHONPATH': str(path)},
        capture_output=True,
        text=True,
        check=True,
        timeout=250,
    )
    return done.stdout


def test_another_installation_of_the_same_sources_compiles_nothing_anew(tmp_path: Path) -> None:
    use = (
        'import numpy; import rpms_ros; from rpms_ros.muscle import recruitment as form; '
        'form.arctan_recruitment(0.5, numpy.array([0.3, 0.7, 6.0, 6.0])); '
        'print(rpms_ros.__file__, sum(form.arctan_recruitment.stats.cache_hits.values()))'
    )
    python(ROOT, '-c', use)
    ignored = shutil.ignore_patterns('__pycache__')
    shutil.copytree(ROOT / 'rpms_ros', tmp_path / 'rpms_ros', ignore=ignored)
    said = python(tmp_path, str(ROOT / 'tools' / 'share_compiled'))
    assert 'folders of compiled functions' in said
    file, hits = python(tmp_path, '-c', use).split()
    assert Path(file).is_relative_to(tmp_path)
    assert hits == '1'
