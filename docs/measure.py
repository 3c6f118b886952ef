# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Write what benchmarks print into docs/measurements.md: `python docs/measure.py [NAME ...]`.

Each fence of that page begins with the command of a benchmark; what it prints takes the place of
the lines below it.  Without names all are run, which takes hours.
"""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / 'docs' / 'measurements.md'
_FENCE = re.compile(
    r'(?P<head>```console\n\$ python (?P<command>[^\n]*)\n).*?(?=^```$)', re.MULTILINE | re.DOTALL
)


def commands(text: str) -> list[str]:
    """Return the commands of the page, each `bench/NAME.py` with its arguments."""
    return [found['command'] for found in _FENCE.finditer(text)]


def written(text: str, names: list[str], run: Callable[[str], str]) -> str:
    """Return the page with the output of the benchmarks of these names, or of all, made anew."""

    def fence(found: re.Match[str]) -> str:
        wanted = not names or Path(found['command'].split()[0]).stem in names
        return f'{found["head"]}{run(found["command"]).strip()}\n' if wanted else found[0]

    return _FENCE.sub(fence, text)


def _run(command: str) -> str:
    print(command, file=sys.stderr)
    return subprocess.check_output([sys.executable, *command.split()], cwd=ROOT, text=True)


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text('utf-8'), sys.argv[1:], _run), encoding='utf-8')
