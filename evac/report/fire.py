"""Smoke, gases and heat of a run: where they come from, the doses that people took, and the time that was left."""

from typing import Any

from evac.report import figures
from evac.report.templates import Section, fixed, section
from evac.results.results import Results

#: Visibility below which a storey is commonly regarded as untenable [m].
TENABLE = 10.0


def fire_section(run: Results) -> Section:
    """Return the section on the conditions of the air of a run.

    Parameters
    ----------
    run : Results
        Of a case with conditions.
    """
    conditions = run.conditions
    assert conditions is not None
    settings: Any = run.settings
    return section(
        "fire",
        "Smoke, gases and heat",
        conditions=conditions,
        dose=conditions["dose"],
        smoke=settings["smoke"],
        levels=[_level(name, times, run) for name, times in conditions["levels"].items()],
        tenable=TENABLE,
        curve=figures.doses(conditions["doses"])
        if conditions["dose"] and len(conditions["doses"]["time"]) > 1
        else None,
        people=run.number_of_people,
    )


def _level(name: str, times: Any, run: Results) -> tuple[object, ...]:
    """Return the row of a level: when smoke makes it untenable, when it was left, and the time between both."""
    use = run.levels[name]
    available, left = times["untenable"], use["last_left"]
    margin = None if available is None or left is None else available - left
    cleared = "not cleared" if use["people"] and left is None else fixed(left, 1)
    return name, fixed(available, 1), fixed(times["turns_back"], 1), cleared, fixed(margin, 1)
