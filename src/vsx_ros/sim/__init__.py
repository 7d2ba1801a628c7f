"""Fourth floor: the emulated world, camera and body."""
