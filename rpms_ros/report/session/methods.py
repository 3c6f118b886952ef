# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Methods of a report: sentence for a paper, command and versions."""

import platform
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version
from typing import TYPE_CHECKING
from typing import Any

import numpy as np

from rpms_ros import __version__
from rpms_ros.axis import QUANTITIES
from rpms_ros.printable import counted

if TYPE_CHECKING:
    from rpms_ros.report.session.analysis import SessionAnalysis

_PACKAGES = ('numpy', 'scipy', 'numba', 'matplotlib')


def methods_of(analysis: 'SessionAnalysis') -> dict[str, Any]:
    """Return the sentence for a paper, the command and the versions of the software."""
    return {
        'sentence': _sentence(analysis),
        'command': analysis.settings.command or None,
        'versions': {
            'rpms_ros': __version__,
            'python': platform.python_version(),
            **{name: _version(name) for name in _PACKAGES},
        },
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'not installed'


def _sentence(analysis: 'SessionAnalysis') -> str:
    result, dose = analysis.result, analysis.dose
    what = QUANTITIES[result.unit]
    found = result.dynamics
    identified, by = 'Recruitment and impulse response', f'estimator {result.estimator}'
    if found is not None:
        identified, by = 'Dynamics', found.model
    parts = [
        (
            f'{identified} were identified with rpms_ros {__version__} '
            f'({by}) from {counted(result.pulses, "pulse")} and '
            f'{counted(result.samples, "sample")} of isometric {what} over '
            f'{result.duration_s:.4g} s'
        )
    ]
    if dose.rate_hz and dose.intensity:
        parts.append(
            f'at {dose.rate_hz["median"]:.4g} Hz and intensities of '
            f'{100 * dose.intensity["lowest"]:.3g} to {100 * dose.intensity["highest"]:.3g} % of '
            'the maximum'
        )
    if found is not None:
        return (
            f'{" ".join(parts)}. The {found.model} fits {found.fit_percent:.1f} % '
            f'(100 (1 - |residual| / |force - mean|)) of {counted(found.trains, "train")} at '
            'their own rate.'
        )
    text = ' '.join(parts) + f'; the recruitment curve is stated for {result.rate_hz:g} Hz'
    if result.confidence:
        text += f' with intervals of {100 * result.confidence:g} %'
    if not np.isfinite(result.output_error_n):
        return f'{text}. No sample was predicted before it was learnt.'
    return (
        f'{text}. The root mean square of measured minus predicted {what} was '
        f'{result.output_error_n:.2g} {result.unit} ({100 * result.output_error_of_range:.2g} % '
        f'of the range of the {what}).'
    )
