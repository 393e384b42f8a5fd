"""Mesh file to frozen `Building`: see ``evac.building.reading.read_building``."""
