"""What a robot's own recordings tell about its camera, its wheels and where the one sits on the other."""
