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

EMERGENCY_STOP = 'emergency_stop'
"""std_msgs/Bool: true stops a driver; std_srvs/Trigger: the same as a service."""

RESET_EMERGENCY_STOP = 'reset_emergency_stop'
"""std_srvs/Trigger: lets go of a latched stop whose cause is gone."""

HEARTBEAT = 'heartbeat'
"""std_msgs/Header: somebody watches; has to keep coming with a new stamp while armed."""

DIAGNOSTICS = '/diagnostics'
"""diagnostic_msgs/DiagnosticArray: absolute, where ROS tools look for them."""
