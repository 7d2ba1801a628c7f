"""Drivers of the robot, usable without ROS and without vsx_ros."""
