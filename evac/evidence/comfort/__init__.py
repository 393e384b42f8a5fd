"""Comfort: accelerations, turns and speeds of people who touch nobody, and steps back over portals."""
