"""Figures, tables and pages about a session; needs no ROS."""
