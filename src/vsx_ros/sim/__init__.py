"""The emulated world, camera and body."""
