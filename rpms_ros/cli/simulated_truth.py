# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is true of a simulated muscle, in a recording."""

from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np

from rpms_ros import estimate_messages
from rpms_ros import messages
from rpms_ros.muscle.truth import Truth
from rpms_ros.recording.definitions import known_types
from rpms_ros.recording.writing import FurtherTopic

TRUTH_TOPIC = '/truth'


def truth_topic(truths: Sequence[Truth]) -> FurtherTopic:
    """Return the messages of topic ``/truth``, each received at its stamp."""
    store = known_types()
    build = store.types[messages.MUSCLE_TRUTH]

    def with_arrays(**fields: Any) -> Any:
        # rosbags writes arrays of NumPy only
        return build(
            **{
                name: np.array(value) if isinstance(value, array) else value
                for name, value in fields.items()
            }
        )

    types = {**store.types, messages.MUSCLE_TRUTH: with_arrays}
    return FurtherTopic(
        TRUTH_TOPIC,
        messages.MUSCLE_TRUTH,
        [truth.stamp_ns for truth in truths],
        [
            bytes(
                store.serialize_cdr(
                    estimate_messages.truth_message(truth, types), messages.MUSCLE_TRUTH
                )
            )
            for truth in truths
        ],
    )
