"""Names of topics, relative to the namespace of the node."""

PULSES = 'pulses'
"""rpms_msgs/Pulse: pulses that were delivered."""

PULSES_COMMANDED = 'pulses_commanded'
"""rpms_msgs/Pulse: pulses that somebody asks for."""

FORCE = 'force'
"""geometry_msgs/WrenchStamped: what the force sensor measures."""

ESTIMATE = 'estimate'
"""rpms_msgs/MuscleEstimate: what is known of the muscle."""

DRIVER_STATUS = 'driver_status'
"""rpms_msgs/DriverStatus: state of a stimulator driver."""

RUN_SCHEDULE = 'run_schedule'
"""rpms_msgs/RunSchedule: action that makes a driver run a schedule."""
