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

from rpms_ros import __all__ as __all__
from rpms_ros.api.identification import Identification as Identification, Parameter as Parameter
from rpms_ros.api.loading import from_arrays as from_arrays, load as load
from rpms_ros.api.session import Session as Session
from rpms_ros.api.simulating import simulate as simulate
from rpms_ros.errors import RpmsError as RpmsError
from rpms_ros.identification.quality.explained_force import Stated as Stated
from rpms_ros.identification.quality.verdict import Verdict as Verdict
from rpms_ros.report.result import Curve as Curve, ImpulseResponse as ImpulseResponse
