"""The RGB camera of the Kinect v1 over USB."""
