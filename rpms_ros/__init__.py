# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""On-line identification of magnetically or electrically stimulated muscle.

In a script or a notebook::

    import rpms_ros

    rpms_ros.load('bags/sample').identify().plot()

What can be used so is described in `rpms_ros.api`; it is loaded when it is first asked for.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.compiled_cache import use_cache_of

if TYPE_CHECKING:
    from rpms_ros.api import (
        Curve,
        Identification,
        ImpulseResponse,
        Parameter,
        RpmsError,
        Session,
        Stated,
        Verdict,
        from_arrays,
        load,
        simulate,
    )

__version__ = '0.1.0'
__all__ = ['Curve', 'Identification', 'ImpulseResponse', 'Parameter', 'RpmsError', 'Session']
__all__ += ['Stated', 'Verdict', 'from_arrays', 'load', 'simulate']

# Before anything is compiled, and before any room imports numba.
use_cache_of(Path(__file__).parent)


def __getattr__(name: str) -> Any:
    """Return a name of `rpms_ros.api`, which loads numpy, scipy and numba."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module('rpms_ros.api'), name)


def __dir__() -> list[str]:
    """Return the names for completion: those that may be used."""
    return [*__all__, '__version__']
