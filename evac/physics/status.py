"""What a sub-step can end in: done, something to be done first, something to make room for, or a failure."""

OK = 0

#: No room in an array, which the engine makes larger before the step is made again.
PAIRS_FULL = 1
WALLS_FULL = 2
CONTACTS_FULL = 3
EVENTS_FULL = 5

#: More walls near one body than a search holds.
NEAR_WALLS_FULL = 4

#: Failures that smaller sub-steps may mend.
WALL_CROSSED = 6
TOO_FAST = 8
TOO_STIFF = 9

#: A failure that they do not.
NOT_FINITE = 7

#: A law asks for contacts within the reaches that it has set, or for overlaps to be separated, and to be called again.
SEARCH_AGAIN = 20
SEPARATE = 21

#: A part that is not loaded: the engine loads it before the step is made again.
FIRST_MISSING_PART = 30
NEEDS_STRONGER_SOLVER = 30
NEEDS_SEPARATION = 31
