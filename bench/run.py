# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the benchmarks of this folder, all or those named, and print their figures.

`make bench` runs all, `make bench ARGS=recursion` one; `ARGS=--list` says what they measure.
"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def is_benchmark(path: Path) -> bool:
    """Whether the file is a benchmark; the others are imported by benchmarks."""
    return path.name != 'run.py' and "if __name__ == '__main__':" in path.read_text('utf-8')


def main(names: list[str]) -> int:
    known = {path.stem: path for path in sorted(HERE.glob('*.py')) if is_benchmark(path)}
    if names == ['--list']:
        for name, path in known.items():
            print(f'{name}: {path.read_text("utf-8").splitlines()[2].strip(chr(34))}')
        return 0
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f'expected benchmarks of {", ".join(known)}, got {", ".join(unknown)}')
        return 2
    failed = []
    for name in names or known:
        print(f'== {name}', flush=True)
        if subprocess.run([sys.executable, str(known[name])], check=False).returncode:
            failed.append(name)
    if failed:
        print(f'failed: {", ".join(failed)}')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
