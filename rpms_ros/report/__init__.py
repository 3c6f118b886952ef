"""Figures and words about a session; needs no ROS."""
