# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic.

Data is reliable and volatile: no sample is skipped, and a late subscriber does not get a part of
earlier samples.  The depths are for a receiver that stalls, not for one that is always too slow.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

_KEPT = DurabilityPolicy.TRANSIENT_LOCAL
_BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT

# Five seconds at 1 kHz, longer than a stall by compilation or garbage collection.
FORCE = QoSProfile(depth=5000)

# For a sensor that publishes best effort; it also receives from reliable publishers.
FORCE_BEST_EFFORT = QoSProfile(depth=5000, reliability=_BEST_EFFORT)

# A hundred seconds at 50 Hz.
PULSES = QoSProfile(depth=5000)

ESTIMATE = QoSProfile(depth=1000)
"""For subscribers of new estimates."""

# A late subscriber that asks for it gets the newest estimate at once, and no older one.
ESTIMATE_KEPT = QoSProfile(depth=1, durability=_KEPT)

DISTURBANCE = QoSProfile(depth=1000)

# Every state, and those of the last seconds for late subscribers; deep enough that a burst of
# changes does not overwrite one before it is read.
STATUS = QoSProfile(depth=100, durability=_KEPT)

# For subscribers that need the newest state only.
STATUS_LATEST = QoSProfile(depth=1, durability=_KEPT)

# The running schedule, also for a recorder that is started after it.
ACCEPTED_SCHEDULE = QoSProfile(depth=1, durability=_KEPT)

# Of a joystick: a press that is released again within a stall counts too.
JOYSTICK = QoSProfile(depth=100, reliability=_BEST_EFFORT)

# Messages that may stop a driver: none is skipped, old ones are not repeated.
STOP = QoSProfile(depth=10)


# State of a button, also for a driver that starts later.
STOP_STATE = QoSProfile(depth=1, durability=_KEPT)

# The queue is common to all publishers; a driver empties it every 5 ms.
STOP_DEPTH = 2000

# Subscriptions of a driver to stops: from publishers of any durability and reliability ...
STOP_LIVE = QoSProfile(depth=STOP_DEPTH, reliability=_BEST_EFFORT)

# ... and with the states published before the driver was started.
STOP_KEPT = QoSProfile(depth=STOP_DEPTH, durability=_KEPT)

# For a view: receives from publishers of any quality of service and does not block them.
VIEW = QoSProfile(depth=5000, reliability=_BEST_EFFORT)

TRUTH = QoSProfile(depth=100)
"""True state of a simulated muscle."""
