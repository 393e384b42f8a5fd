"""Status codes of sub-steps: success, a request, a full array, or a failure."""

OK = 0

#: An array is full; the engine enlarges it and repeats the step.
PAIRS_FULL = 1
WALLS_FULL = 2
CONTACTS_FULL = 3
EVENTS_FULL = 5

NEAR_WALLS_FULL = 4  #: There are more walls near one body than the wall search can hold.

#: Failures that smaller sub-steps may avoid.
WALL_CROSSED = 6
TOO_FAST = 8
TOO_STIFF = 9
CENTRES_PASSED = 10

NOT_FINITE = 7  #: A failure that smaller sub-steps do not avoid.

#: A law requests another contact search with new reaches, or a separation of overlaps, and then another call.
SEARCH_AGAIN = 20
SEPARATE = 21

#: A part is not loaded; the engine loads it and repeats the step.
FIRST_MISSING_PART = 30
NEEDS_STRONGER_SOLVER = 30
NEEDS_SEPARATION = 31
