"""On-line identification of magnetically or electrically stimulated muscle."""

from pathlib import Path

from rpms_ros.compiled_cache import use_cache_of

__version__ = '0.1.0'

# Before anything is compiled, and before any room imports numba.
use_cache_of(Path(__file__).parent)
