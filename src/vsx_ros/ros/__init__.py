"""The roof, east: the only room that knows ROS."""
