# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Duration of the forecast of a long schedule, during which the executor gives no sign of life.

Process time, the best of some, for each device specification of the package.
"""

import argparse
import sys
import time

from rpms_ros.stimulation import Schedule, UniformRandom
from rpms_ros.stimulation.limits.device_specification import (
    load_device_specification,
    profile_names,
)
from rpms_ros.stimulation.limits.forecast import forecast

RATE_HZ = 20.0
TRIALS = 5


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--pulses', type=int, default=90_000)
    arguments = parser.parse_args(argv)
    length_s = arguments.pulses / RATE_HZ
    schedule = Schedule((UniformRandom(RATE_HZ, length_s, low=0.0, high=1.0),))
    # computed once, then cached
    count = len(schedule.plan)
    for name in profile_names():
        specification = load_device_specification(name)
        took_s = []
        for _ in range(TRIALS):
            began = time.process_time()
            forecast(schedule, specification)
            took_s.append(time.process_time() - began)
        print(f'forecast of {count} pulses on {name}: {1e3 * min(took_s):.1f} ms')
    return 0


if __name__ == '__main__':
    sys.exit(main())
