"""Smoke, gases and heat of a run: where they come from, the doses that people took, and the time that was left."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from evac.base.defaults import TENABLE
from evac.building.model.storeys import storeys
from evac.report import figures
from evac.report.templates import Cell, Section, fixed, section
from evac.results.results import Results


def fire_section(run: Results) -> Section:
    """Return the section on the conditions of the air of a run."""
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
    # Of a run without a trajectory, the storeys are not known.
    groups = [(name, [name]) for name in run.levels]
    if run.building_or_none is not None:
        groups = [(name, [level.name for level in levels]) for name, levels in storeys(run.building)]
    return section(
        "margins",
        "Available and required safe egress times",
        rows=[_storey(name, levels, given, smoky, run) for name, levels in groups],
        tenable=TENABLE,
        smoke=settings["smoke"] if smoky else None,
    )


def _storey(
    name: str, levels: Sequence[str], given: Mapping[str, float], smoky: Mapping[str, Any], run: Results
) -> tuple[object, ...]:
    """Return the row of a storey with its stairs: when it is untenable, when it was left, and the time between both."""
    stated = _extreme(min, [given.get(level) for level in levels])
    smoke = [_extreme(min, [smoky[level][key] for level in levels if smoky]) for key in ("untenable", "turns_back")]
    available = _extreme(min, [stated, smoke[0]])
    used = [use for use in map(run.levels.__getitem__, levels) if use["people"]]
    is_cleared = all(use["last_left"] is not None for use in used)
    left = _extreme(max, [use["last_left"] for use in used]) if is_cleared else None
    margin = None if available is None or left is None else available - left
    words = "none" if available is not None and not is_cleared else fixed(margin, 1)
    shown = Cell(words, "bad") if words == "none" or (margin is not None and margin < 0.0) else words
    cleared = fixed(left, 1) if is_cleared else "not cleared"
    return name, fixed(stated, 1), *(fixed(time, 1) for time in smoke), cleared, shown


def _extreme(of: Callable[[list[float]], float], times: Sequence[float | None]) -> float | None:
    """Return the least or greatest of the times that are known."""
    known = [time for time in times if time is not None]
    return of(known) if known else None
