"""The occupants: how many, where, what they are like and what they are assumed to do."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from evac.report.html import Html, Section, counted, fixed, heading, paragraph, table
from evac.results.record import CaseTable, GroupTable
from evac.results.results import Results

#: Quantities of a person: the column of people.csv, what it is, its unit, and digits behind the point.
QUANTITIES = {
    "speed": ("desired speed on the flat", "m/s", 2),
    "speed_up": ("desired speed up stairs, along the slope", "m/s", 2),
    "speed_down": ("desired speed down stairs, along the slope", "m/s", 2),
    "radius": ("radius of the body", "m", 3),
    "height": ("height of the body", "m", 2),
    "mass": ("mass", "kg", 1),
    "tau": ("relaxation time", "s", 2),
}


def occupants_section(case: CaseTable, run: Results | None) -> Section:
    """Return the section on the occupants of a case, with what a run has drawn."""
    total = sum(group.size for group in case.people)
    parts = [
        paragraph(
            f"{counted(total, 'person', 'people')} in {counted(len(case.people), 'group')}. The simulation starts at"
            " time zero, the time of the alarm."
        ),
        _groups(case, run),
        heading("Characteristics"),
        paragraph(
            "Each value is drawn once for each person, from the distribution of the case."
            + (" The other columns show the values that were drawn in this run." if run else "")
        ),
        *_characteristics(case, run),
        heading("Response times and behaviours"),
        *_behaviours(case, run),
    ]
    return Section("occupants", "Occupants and assumptions", tuple(parts))


def told(value: Any) -> str:
    """Return a value of a case as words: a distribution as its name and numbers."""
    if isinstance(value, Mapping):
        return "; ".join(_told_pair(key, one) for key, one in value.items()) or "-"
    if isinstance(value, list | tuple):
        listed = [told(one) for one in value]
        return ", ".join(listed if len(listed) <= 12 else [*listed[:3], "...", f"{len(listed)} values"]) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "inf"  # JSON has no other word for it
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _told_pair(key: str, value: Any) -> str:
    if key == "uniform" and isinstance(value, list) and len(value) == 2:
        return f"uniform from {told(value[0])} to {told(value[1])}"
    return f"{key}: {told(value)}"


def _groups(case: CaseTable, run: Results | None) -> Html:
    building = run.trajectory.building if run and run.trajectory else None
    areas = {area.name: area.polygon.area for area in building.areas} if building else {}

    def row(group: GroupTable) -> tuple[object, ...]:
        number = group.size
        size = areas.get(group.area or "")
        if group.area:
            where = f"area {group.area}"
        else:
            on = f"level {group.level}" if group.level else f"z = {group.z:g} m" if group.z is not None else "a level"
            where = f"given places on {on}"
        density = fixed(number / size, 2) if size else None
        heads = ", ".join(group.exits) or "any exit"
        return group.name, number, where, density, heads, group.strategy

    columns = ("group", "people", "start", "people per m² of the area", "exits", "route")
    return table("Groups, their start areas, exits and routes", columns, [row(group) for group in case.people])


def _characteristics(case: CaseTable, run: Results | None) -> Iterator[Html]:
    """Yield a table for each set of groups that have the same characteristics."""
    alike: dict[str, list[GroupTable]] = {}
    for group in case.people:
        given = {name: (group.model_extra or {}).get(name) for name in QUANTITIES}
        limited = (group.model_extra or {}).get("limit_stair_speeds")
        alike.setdefault(repr((given, limited)), []).append(group)
    for groups in alike.values():
        names = ", ".join(group.name for group in groups)
        given = groups[0].model_extra or {}
        rows = [
            (what, unit, told(given.get(name)), *_drawn(run, groups, name, digits))
            for name, (what, unit, digits) in QUANTITIES.items()
        ]
        columns = ("quantity", "unit", "distribution", *(("minimum", "mean", "maximum") if run else ()))
        people = counted(sum(group.size for group in groups), "person", "people")
        yield table(f"{people}: {names}", columns, rows)
        if given.get("limit_stair_speeds"):
            yield paragraph("Desired speeds on stairs are limited to the desired speed on the flat.", class_="small")


def _drawn(run: Results | None, groups: list[GroupTable], column: str, digits: int) -> tuple[str | None, ...]:
    if run is None:
        return ()
    names = {group.name for group in groups}
    rows = np.concatenate([group.rows for group in run.groups if group.name in names])
    speeds = dict(zip(("speed", "speed_up", "speed_down"), run.crowd.speed.T, strict=True))
    values = (run.crowd.values() | speeds)[column][rows]
    return tuple(fixed(number, digits) for number in _least_mean_greatest(values)) if len(values) else (None,) * 3


def _least_mean_greatest(values: np.ndarray) -> tuple[float | None, ...]:
    numbers = (float(values.min()), float(values.mean()), float(values.max()))
    return tuple(number if math.isfinite(number) else None for number in numbers)


def _behaviours(case: CaseTable, run: Results | None) -> Iterator[Html]:
    """Yield what people do: behaviours, and response times that a run has drawn."""
    enabled = {name: values for name, values in case.behaviours.items() if values is not False}
    if enabled:
        rows = [(name, told(values)) for name, values in enabled.items()]
        yield table("Behaviours in use and their parameters", ("behaviour", "parameters"), rows)
        own = [
            (group.name, name, told(values))
            for group in case.people
            for name, values in group.behaviours.items()
            if name in enabled
        ]
        if own:
            yield table("Settings of single groups", ("group", "behaviour", "parameters"), own)
    else:
        yield paragraph("No behaviour is in use: all people start at time zero and follow their routes.")
    if run is not None and run.number_of_people:
        drawn = [
            (group.name, *(fixed(number, 1) for number in _least_mean_greatest(run.crowd.start_time[group.rows])))
            for group in run.groups
            if len(group.rows)
        ]
        columns = ("group", "minimum [s]", "mean [s]", "maximum [s]")
        yield table("Response times drawn in this run: people start to walk at these times", columns, drawn)
