"""Surface mesh to frozen `Building`: see ``evac.building.build.build_building``."""
