# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The package in a script or a notebook: load, identify, plot, hand on.

Everything here is also found in `rpms_ros` itself::

    import rpms_ros

    session = rpms_ros.load('bags/sample')
    result = session.identify()
    result.plot()

These names and their parameters are stable; what lies below them in other modules may change.
Nothing here needs ROS.
"""

from rpms_ros.api.identification import Identification, Parameter
from rpms_ros.api.loading import from_arrays, load
from rpms_ros.api.session import Session
from rpms_ros.api.simulating import simulate
from rpms_ros.errors import RpmsError
from rpms_ros.identification.quality.explained_force import Stated
from rpms_ros.identification.quality.verdict import Verdict
from rpms_ros.report.result import Curve, ImpulseResponse

__all__ = ['Curve', 'Identification', 'ImpulseResponse', 'Parameter', 'RpmsError', 'Session']
__all__ += ['Stated', 'Verdict', 'from_arrays', 'load', 'simulate']
