"""iRobot Create 1, Create 2 and Roomba 500/600 (Open Interface)."""
