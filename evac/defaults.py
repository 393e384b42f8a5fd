"""Defaults that the schema of case.toml and the functions called from Python share; importing them costs nothing."""

#: Vertices of a mesh that are closer than this become one [m].
WELD = 0.001
#: Cells less steep than the first are floors and landings, steeper than the second cannot be walked on [degrees].
FLAT_ANGLE = 3.0
WALKABLE_ANGLE = 50.0
#: Metres per unit of a building's file.
SCALE = 1.0

#: Distance of the nodes of the grid of directions [m].
SPACING = 0.1
#: Weight of the time on stairs for the strategy "comfortable".
COMFORT = 3.0
#: Order of the fast marching scheme.
ORDER = 2
