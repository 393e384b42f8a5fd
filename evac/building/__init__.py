"""Conversion of plans and surface meshes to a frozen `Building`: see `evac.building.surface.build.build_building`."""
