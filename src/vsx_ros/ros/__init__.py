"""The ROS layer: the only package that imports ROS."""
