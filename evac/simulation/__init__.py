"""A run: its parts, scene, loop, checkpoints, and outputs."""
