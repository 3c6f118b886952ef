# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where compiled functions are kept: one folder for each state of the sources.

numba looks whether the file of a compiled function has changed, not the files of what that
function calls: after an edit of those it would run the old mathematics.  So what was compiled from
other sources is not looked at.
"""

import hashlib
import os
import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path

_PREFIX = 'rpms_ros-'
# A state of the sources that was worked on lately is worth its compiled functions.
_MOST_STATES = 4
# Lines that are a comment, and statements that are nothing but a text.
_REMARKS = re.compile(
    rb'(?ms)^[ \t]*(?:#[^\n]*|r?"""[^"\\]*(?:(?:\\.|""?(?!"))[^"\\]*)*"""[ \t]*)\n'
)


def key_of(package: Path) -> str:
    """Return a name for the state of all sources of a package that hold compiled functions.

    Comments and docstrings do not count: after an edit of those, numba compiles the functions of
    that file anew, and what calls them is still right.
    """
    digest = hashlib.sha256()
    # another process may take folders of other states away meanwhile, which os.walk passes over
    found = (Path(folder, name) for folder, _, names in os.walk(package) for name in names)
    for path in sorted(path for path in found if path.suffix == '.py'):
        content = path.read_bytes()
        if b'njit' in content:
            code = _REMARKS.sub(b'', content)
            digest.update(f'{path.relative_to(package)} {len(code)} '.encode())
            digest.update(code)
    return _PREFIX + digest.hexdigest()[:16]


def use_cache_of(package: Path) -> None:
    """Let numba keep what it compiles in a folder of these sources.

    Below ``NUMBA_CACHE_DIR`` if it is set, else in the ``__pycache__`` of the package, else in
    the user's cache.  Where nothing can be written, numba does as it always does.
    """
    key = key_of(package)
    given = os.environ.get('NUMBA_CACHE_DIR')
    if given and Path(given).name == key:
        return
    own = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache', 'rpms_ros')
    for base in [Path(given)] if given else [package / '__pycache__', own]:
        folder = base / key
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                folder.touch()
                os.environ['NUMBA_CACHE_DIR'] = str(folder)
                if 'numba' in sys.modules:
                    # It has read its environment already.
                    sys.modules['numba'].config.CACHE_DIR = str(folder)
                with suppress(OSError):
                    states = sorted(base.glob(f'{_PREFIX}*'), key=os.path.getmtime)
                    for state in states[:-_MOST_STATES]:
                        shutil.rmtree(state, ignore_errors=True)
                return
