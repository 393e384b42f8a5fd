"""Smoke, gases and heat of a run: where they come from, the doses that people took, and the time that was left."""

from collections.abc import Mapping
from typing import Any

from evac.report import figures
from evac.report.templates import Cell, Section, fixed, section
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
    return section(
        "fire",
        "Smoke, gases and heat",
        conditions=conditions,
        dose=conditions["dose"],
        curve=figures.doses(conditions["doses"])
        if conditions["dose"] and len(conditions["doses"]["time"]) > 1
        else None,
        people=run.number_of_people,
    )


def margins_section(run: Results) -> Section | None:
    """Return the section with available times, given or from smoke, beside required ones; None if there are none."""
    given, settings = run.record.table.report.aset, run.settings
    smoky: Mapping[str, Any] = {} if run.conditions is None else run.conditions["levels"]
    if not given and not smoky:
        return None
    return section(
        "margins",
        "Available and required safe egress times",
        rows=[_level(name, given.get(name), smoky.get(name), use) for name, use in run.levels.items()],
        tenable=TENABLE,
        smoke=settings["smoke"] if smoky else None,
    )


def _level(
    name: str, given: float | None, smoky: Mapping[str, Any] | None, use: Mapping[str, Any]
) -> tuple[object, ...]:
    """Return the row of a level: when it is untenable, when it was left, and the time between both."""
    smoke = (None,) * 2 if smoky is None else (smoky["untenable"], smoky["turns_back"])
    available = min((time for time in (given, smoke[0]) if time is not None), default=None)
    left, used = use["last_left"], use["people"]
    cleared = "not cleared" if used and left is None else fixed(left, 1)
    margin = None if available is None or left is None else available - left
    words = fixed(margin, 1)
    if available is not None and used and left is None:
        words = "none"
    shown = Cell(words, "bad") if words == "none" or (margin is not None and margin < 0.0) else words
    return name, fixed(given, 1), *(fixed(time, 1) for time in smoke), cleared, shown
