# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Health of an identifier: whether force comes, and whether the estimate can be trusted."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.identification import Estimate
from rpms_ros.identification.plausibility import stated_doubt
from rpms_ros.nodes.diagnostics import Health


def identifier_health(
    estimate: Estimate | None, faults: Mapping[str, int], silent: bool, held: bool
) -> Health:
    """Return the health of an identifier.

    Stale while no force comes, a warning while the newest estimate is in doubt, ok otherwise.
    """
    level, text = DiagnosticStatus.OK, 'held: predicts, does not learn' if held else 'identifying'
    if estimate is None:
        text = 'no estimate yet'
    elif estimate.doubts:
        level, text = DiagnosticStatus.WARN, f'in doubt: {", ".join(estimate.doubts)}'
    if silent:
        level, text = DiagnosticStatus.STALE, 'no force'
    figures: dict[str, object] = {'held': held}
    if estimate is not None:
        figures |= {
            'estimator': estimate.estimator,
            'samples': estimate.samples,
            'pulses': estimate.pulses,
            'output error': f'{estimate.output_error:.4g}',
            'curve known': estimate.curve_known,
            'changes': estimate.changes,
        }
        if estimate.reasons:
            figures['reasons'] = '; '.join(estimate.reasons)
    figures |= {f'fault {fault}': count for fault, count in faults.items()}
    return Health(text, level, figures)


def doubts_in_words(estimate: Estimate | None) -> str:
    """Return why an estimate is not to be trusted; empty if nothing speaks against it."""
    if estimate is None:
        return ''
    return '; '.join(stated_doubt(estimate, name) for name in estimate.doubts)
