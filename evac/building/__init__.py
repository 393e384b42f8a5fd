"""Conversion of plans and surface meshes to a frozen `Building`: see `evac.building.build.build_building`."""
