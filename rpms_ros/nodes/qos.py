# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic.

Data is reliable and volatile: a sample is never skipped, and who joins late does not get samples
that no longer belong together.  Depths bridge a stall of the receiver, not a slow receiver.
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


# Five seconds at 1 kHz: longer than compiling or a garbage collection ever takes.
FORCE = _profile(5000)

# For a subscription to a sensor that does not offer more; it hears reliable ones as well.
FORCE_BEST_EFFORT = _profile(5000, reliability=ReliabilityPolicy.BEST_EFFORT)

# A hundred seconds at 50 Hz.
PULSES = _profile(5000)

ESTIMATE = _profile(1000)
"""For those who hear estimates from now on."""

# Who joins late and asks for it gets the newest at once.
ESTIMATE_KEPT = _profile(1000, DurabilityPolicy.TRANSIENT_LOCAL)

DISTURBANCE = _profile(1000)

# Every state, and those of the last seconds also for those who join later; a burst of changes must
# not push any of them out before it is read.
STATUS = _profile(100, DurabilityPolicy.TRANSIENT_LOCAL)

# For those to whom the newest state matters alone.
STATUS_LATEST = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# The schedule that runs, also for a recorder that is started after it.
ACCEPTED_SCHEDULE = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# What the subscription that use_sim_time makes expects: only the newest time matters.
CLOCK = _profile(1, reliability=ReliabilityPolicy.BEST_EFFORT)

# Where only the newest message counts, of whatever publisher.
LATEST = _profile(1, reliability=ReliabilityPolicy.BEST_EFFORT)

# What may stop a driver: nothing is skipped, and nothing old is waited for.
STOP = _profile(10)


# What a button says: also for a driver that starts later.
STOP_STATE = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# The queue holds the messages of all publishers together; a driver empties it every 5 ms.
STOP_DEPTH = 2000

# How a driver hears what may stop it: publishers that repeat nothing are heard as well ...
STOP_LIVE = _profile(STOP_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)

# ... and what was said before the driver was there.
STOP_KEPT = _profile(STOP_DEPTH, DurabilityPolicy.TRANSIENT_LOCAL)

# For a view: hears every publisher, whatever it offers, and makes none wait.
VIEW = _profile(5000, reliability=ReliabilityPolicy.BEST_EFFORT)

TRUTH = _profile(100)
"""What is true of a simulated muscle."""
