"""The tallies: counts, sums and maxima that a run collects.

`State.tally` has the current values, `State.tally_before` those at the start of the step, to undo it.
"""

(
    STEPS,
    SUB_STEPS,
    LIST_BUILDS,
    CONTACTS,
    GREATEST_OVERLAP,
    OVERLAP_SUM,
    OVERLAPS,
    SOLVES,
    ITERATIONS,
    GREATEST_RESIDUAL,
    UNCONVERGED_STEPS,
    RETRIED_SOLVES,
    POSITION_CORRECTIONS,
    DRIVING_WORK,
    CONTACT_DISSIPATION,
    CONTACT_CREATION,
    WALL_CROSSINGS_PREVENTED,
    TOO_FAST_STEPS,
    GREATEST_SPEED,
    ELASTIC_FALLBACKS,
    TOO_STIFF_STEPS,
    FAILED_POSITION_CORRECTIONS,
    REPEATED_SEARCHES,
    PASSES_PREVENTED,
    FAILED_SOLVES,
    DEEPEST_TIME,
    DEEPEST_PERSON,
    DEEPEST_LEVEL,
    DEEPEST_X,
    DEEPEST_Y,
) = range(30)

NAMES = tuple(name.lower() for name in [*globals()] if name.isupper())  #: Names of the tallies, in order.

#: Tallies that are not counts.
MEASURES = {
    "greatest_overlap",
    "overlap_sum",
    "greatest_residual",
    "driving_work",
    "contact_dissipation",
    "contact_creation",
    "greatest_speed",
}

#: Time [s] and place of the largest overlap, reported by `CompiledEngine.contact_report`.
DEEPEST = ("deepest_time", "deepest_person", "deepest_level", "deepest_x", "deepest_y")
