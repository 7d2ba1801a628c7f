"""Third floor, west: keyframe SLAM (paper 3.1)."""
