# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A made-up session that runs all compiled code of an estimator, so that it is compiled.

The first run on a machine compiles for a minute or two.  A node that did so while it is running
would not hear its topics meanwhile.  All estimators of this package at once, as `make build` does:

    python -m rpms_ros.identification.warm_up
"""

import multiprocessing
import os
import platform
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np

from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.identification.model.estimate import Estimator
from rpms_ros.identification.model.settings import PEOPLE_PRESET
from rpms_ros.identification.offline import identify
from rpms_ros.identification.stream.stream import StreamSettings
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

_PULSE_RATE_HZ = 20
_FORCE_RATE_HZ = 250
# Share of the twitch that is left a sample later: a time constant of 40 ms.
_DECAY = float(np.exp(-1.0 / (0.04 * _FORCE_RATE_HZ)))
_NOISE = 0.01
# What runs at once, and what runs when a session is long or a muscle has changed [s].
_SHORT, _LONG = 2.0, 26.0
_CHANGE_AT, _CHANGE = 0.6, 0.7
# What compiles longest first.
_ALL = (
    ('batch', PEOPLE_PRESET),
    ('tracking', PEOPLE_PRESET),
    ('recursive', PEOPLE_PRESET),
    ('recursive', 'paper_table_4'),
)


def warm_up(
    build: Callable[[], Estimator], tell: Callable[[], object] = lambda: None, load: bool = True
) -> None:
    """Compile what an estimator runs.

    Parameters
    ----------
    build : callable
        Returns a new estimator.
    tell : callable, optional
        Called before anything is compiled; not at all if that was done before.
    load : bool
        If that was done before, load it: for a node, whose samples would wait meanwhile.
    """
    settings = StreamSettings(estimate_period=1.0)
    estimator = build()
    marker = _marker(f'{type(estimator).__name__}-{estimator.name}')
    compiled = marker is not None and marker.exists()
    if not compiled:
        tell()
    if load or not compiled:
        identify(estimator, *made_up_session(_SHORT), settings)
    if compiled:
        return
    identify(build(), *made_up_session(_LONG), settings)
    if marker is not None:
        with suppress(OSError):
            marker.touch()


def _marker(name: str) -> Path | None:
    """Return the file that says that everything of an estimator was compiled here."""
    folder = os.environ.get('NUMBA_CACHE_DIR')
    if not folder:
        return None
    # a folder that several machines share holds what each of them has compiled
    return Path(folder, f'compiled-{name}-{numba.__version__}-{platform.node()}')


def made_up_session(seconds: float) -> tuple[PulseTrain, ForceTrace]:
    """Return pulses of random intensity and the force of a muscle that is weaker at the end.

    Parameters
    ----------
    seconds : float
        Duration [s].
    """
    generator = np.random.default_rng(0)
    intensity = generator.uniform(0.2, 1.0, int(seconds * _PULSE_RATE_HZ))
    drive = np.zeros(int(seconds * _FORCE_RATE_HZ))
    place = np.arange(len(intensity)) * _FORCE_RATE_HZ // _PULSE_RATE_HZ
    drive[place] = np.clip(2.0 * intensity - 0.8, 0.0, 1.0)
    force = _NOISE * generator.standard_normal(len(drive))
    first = second = 0.0
    for index, one in enumerate(drive.tolist()):
        first = _DECAY * first + one
        second = _DECAY * second + 0.2 * first
        force[index] += second if index < _CHANGE_AT * len(drive) else _CHANGE * second
    stamp_ns = np.arange(len(drive), dtype=np.int64) * (NANOSECONDS_PER_SECOND // _FORCE_RATE_HZ)
    return PulseTrain.regular(intensity, _PULSE_RATE_HZ), ForceTrace(stamp_ns, force)


def _warm_up_named(name: str, preset: str) -> None:
    warm_up(lambda: estimator_by_name(name, preset))


def main() -> None:
    """Compile every estimator of this package, several at a time."""
    # of four, one takes half of the time
    workers = min(2, os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, multiprocessing.get_context('spawn')) as pool:
        list(pool.map(_warm_up_named, *zip(*_ALL, strict=True)))


if __name__ == '__main__':
    main()
