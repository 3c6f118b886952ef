"""ROS nodes: parameters, topics, clocks, life cycle.  Only this part imports rclpy."""
