"""Dense planar mapping (paper 5.1): planes of the sparse map, and which parts of each are surface."""
