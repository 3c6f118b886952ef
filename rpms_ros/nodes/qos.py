# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic.

Data is reliable and volatile: no sample is skipped, and a late subscriber does not get a part of
earlier samples.  The depths are for a receiver that stalls, not for one that is always too slow.
"""

from rclpy.qos import DurabilityPolicy
from rclpy.qos import HistoryPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy


def _profile(
    depth: int,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=durability,
    )


# Five seconds at 1 kHz, longer than a stall by compilation or garbage collection.
FORCE = _profile(5000)

# For a sensor that publishes best effort; it also receives from reliable publishers.
FORCE_BEST_EFFORT = _profile(5000, reliability=ReliabilityPolicy.BEST_EFFORT)

# A hundred seconds at 50 Hz.
PULSES = _profile(5000)

ESTIMATE = _profile(1000)
"""For subscribers of new estimates."""

# A late subscriber that asks for it gets the newest estimate at once, and no older one.
ESTIMATE_KEPT = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

DISTURBANCE = _profile(1000)

# Every state, and those of the last seconds for late subscribers; deep enough that a burst of
# changes does not overwrite one before it is read.
STATUS = _profile(100, DurabilityPolicy.TRANSIENT_LOCAL)

# For subscribers that need the newest state only.
STATUS_LATEST = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# The running schedule, also for a recorder that is started after it.
ACCEPTED_SCHEDULE = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# As the subscription of use_sim_time expects: only the newest time matters.
CLOCK = _profile(1, reliability=ReliabilityPolicy.BEST_EFFORT)

# Of a joystick: a press that is released again within a stall counts too.
JOYSTICK = _profile(100, reliability=ReliabilityPolicy.BEST_EFFORT)

# Messages that may stop a driver: none is skipped, old ones are not repeated.
STOP = _profile(10)


# State of a button, also for a driver that starts later.
STOP_STATE = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# The queue is common to all publishers; a driver empties it every 5 ms.
STOP_DEPTH = 2000

# Subscriptions of a driver to stops: from publishers of any durability and reliability ...
STOP_LIVE = _profile(STOP_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)

# ... and with the states published before the driver was started.
STOP_KEPT = _profile(STOP_DEPTH, DurabilityPolicy.TRANSIENT_LOCAL)

# For a view: receives from publishers of any quality of service and does not block them.
VIEW = _profile(5000, reliability=ReliabilityPolicy.BEST_EFFORT)

TRUTH = _profile(100)
"""True state of a simulated muscle."""
