"""Defaults and bounds shared by the schema of case.toml and the Python functions; cheap to import."""

#: Vertices of a mesh that are closer than this are merged [m].
WELD = 0.001
HEADROOM = 2.0  #: Least height above the ground of solid bodies, and above and below flights [m].

#: Greatest absolute coordinate, height or length [m]: farther from the origin, rounding errors exceed a millimetre.
FARTHEST = 1e8

#: Shorter segments of buildings are dropped, and points closer to each other are the same [m].
LEAST_LENGTH = 1e-3
DOOR_REACH = 0.6  #: Greatest thickness of a wall that a door or an exit of a plan leads through [m].
LONGEST_NAME = 200  #: Greatest number of characters in a title and in the name of a group or of a part of a building.

#: Distance of the nodes of the grid of directions [m].
SPACING = 0.1
#: Weight of the time on stairs for the strategy "comfortable".
COMFORT = 3.0
ORDER = 2  #: Order of the fast marching scheme.
CONTRAST = 3.0  #: Visibility times extinction coefficient of smoke, for things that reflect light.
LEAST_FLOOR = 0.01  #: Least relative speed of people in a crowd, for the strategy "quickest".

#: Least radius of a body [m]: below that of any person; smaller ones would need too much memory.
LEAST_RADIUS = 0.01
#: Greatest radius [m], mass [kg], relaxation time [s] and speed [m/s]: beyond any person, far from overflow.
MOST_RADIUS, MOST_MASS, MOST_TAU, MOST_SPEED = 10.0, 1e5, 1e4, 100.0

LEAST_HEIGHT, MOST_HEIGHT = 0.3, 3.0  #: Least and greatest body height [m].

#: Distance from which signs are seen that state none [m]: that of a sign of 0.15 m that is lit from inside (EN 1838:
#: 200 times its height, and 100 times that of others, as makers of emergency lighting quote it).
SIGN_RANGE = 30.0
#: Share of the walkable ground that a file may lose, or that may have no way out, such as a closet without a door.
NEGLIGIBLE = 0.02
