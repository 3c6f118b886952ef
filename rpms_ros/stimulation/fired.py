# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One pulse as listeners are told of it."""

from dataclasses import dataclass

from rpms_ros.stimulation.devices.interface import Delivery


@dataclass(frozen=True)
class Fired:
    """One pulse whose trigger was sent to the device.

    Attributes
    ----------
    due_ns : int
        When the schedule wanted it, monotonic clock [ns].
    intensity : float
        What was commanded (share).
    width_s : float
        Duration [s].
    sequence : int
        Counts the commanded pulses.
    delivery : Delivery or None
        What the device says it did; all of it unverified if the device did not answer; None if it
        says that no pulse came.
    delivered_sequence : int
        Counts those with a delivery.
    answered : bool
        Whether the device answered.
    """

    due_ns: int
    intensity: float
    width_s: float
    sequence: int
    delivery: Delivery | None
    delivered_sequence: int
    answered: bool = True
