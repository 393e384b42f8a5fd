"""What a mesh is read with where nothing else is given."""

#: Vertices closer than this become one [m].
WELD = 0.001
#: Cells less steep than this are floors and landings, steeper than the second cannot be walked on [degrees].
FLAT_ANGLE = 3.0
WALKABLE_ANGLE = 50.0
#: Metres per unit of the file.
SCALE = 1.0
