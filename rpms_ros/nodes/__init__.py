"""ROS nodes: parameters, topics, clocks, life cycle.  The only room that imports rclpy."""
