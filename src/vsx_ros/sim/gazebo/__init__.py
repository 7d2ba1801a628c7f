"""Gazebo worlds: SDF files with the meshes and textures they name, read into arrays."""
