"""What travel times and directions are computed with where nothing else is given."""

#: Distance of the grid's nodes [m].
SPACING = 0.1
#: Weight of the time on stairs for the strategy "comfortable".
COMFORT = 3.0
#: Order of the fast marching scheme.
ORDER = 2
