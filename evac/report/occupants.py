"""The occupants: how many, where, what they are like and what they are assumed to do."""

from typing import Any

import numpy as np

from evac.base.distributions import told
from evac.base.errors import in_order
from evac.report.templates import Section, fixed, section
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
    enabled = {name: values for name, values in case.behaviours.items() if values is not False}
    responses = []
    if run is not None:
        starts = [(group.name, run.crowd.start_time[group.rows]) for group in in_order(run.groups)]
        responses = [(name, *_least_mean_greatest(times, 1)) for name, times in starts if len(times)]
    return section(
        "occupants",
        "Occupants and assumptions",
        people=sum(_size(group, run) for group in case.people),
        groups=_groups(case, run),
        characteristics=_characteristics(case, run),
        is_drawn=run is not None,
        behaviours=[(name, told(values)) for name, values in enabled.items()],
        settings=[
            (group.name, name, told(values))
            for group in in_order(case.people)
            for name, values in group.behaviours.items()
            if name in enabled
        ],
        responses=responses,
    )


def _groups(case: CaseTable, run: Results | None) -> list[tuple[object, ...]]:
    """Return name, number of people, start, density, exits and strategy of each group."""
    building = run.trajectory.building if run and run.trajectory else None
    areas = {area.name: area.polygon.area for area in building.areas} if building else {}

    def row(group: GroupTable) -> tuple[object, ...]:
        size = None if group.arrive else areas.get(group.area or "")
        density = fixed(group.size / size, 2) if size else None
        ways = (", ".join(group.exits) or "any exit") if group.leave else "they stay"
        if group.leave and group.assembly:
            ways = f"assembly area {', '.join(group.assembly)}"
        return group.name, _size(group, run), _start(group), density, ways, group.strategy

    return [row(group) for group in in_order(case.people)]


def _size(group: GroupTable, run: Results | None) -> int:
    """Return the number of people of a group: in a run, those who were drawn to arrive as well."""
    return group.size if run is None else next(len(one.rows) for one in run.groups if one.name == group.name)


def _start(group: GroupTable) -> str:
    """Return where the people of a group start, or where and when they arrive."""
    on = f"level {group.level}" if group.level else f"z = {group.z:g} m" if group.z is not None else "a level"
    where = f"area {group.area}" if group.area else on if group.positions is None else f"given places on {on}"
    if group.arrive is None:
        return where
    for kind in ("exit", "portal"):
        if name := group.arrive.get(kind):
            where = f"{kind} {name}"
    if times := group.arrive.get("times"):
        return f"arrive: {where}, {len(times)} from {min(times):g} to {max(times):g} s"
    span = f"from {group.arrive.get('from', 0.0):g} to {group.arrive.get('to', 0.0):g} s"
    return f"arrive: {where}, {group.arrive.get('rate', 0.0):g} per second {span}"


def _characteristics(case: CaseTable, run: Results | None) -> list[dict[str, Any]]:
    """Return names, number of people and a row for each quantity of each set of groups with the same ones."""
    alike: dict[str, list[GroupTable]] = {}
    for group in in_order(case.people):
        given = {name: (group.model_extra or {}).get(name) for name in (*QUANTITIES, "limit_stair_speeds")}
        alike.setdefault(repr(given), []).append(group)
    rows = []
    for groups in alike.values():
        given = groups[0].model_extra or {}
        rows.append(
            {
                "names": ", ".join(group.name for group in groups),
                "people": sum(_size(group, run) for group in groups),
                "rows": [
                    (what, unit, told(given.get(name)), *_drawn(run, groups, name, digits))
                    for name, (what, unit, digits) in QUANTITIES.items()
                ],
                "is_limited": given.get("limit_stair_speeds"),
            }
        )
    return rows


def _drawn(run: Results | None, groups: list[GroupTable], column: str, digits: int) -> tuple[str | None, ...]:
    """Return minimum, mean and maximum of a quantity of the people of some groups; nothing without a run."""
    if run is None:
        return ()
    names = {group.name for group in groups}
    rows = np.concatenate([group.rows for group in run.groups if group.name in names])
    speeds = dict(zip(("speed", "speed_up", "speed_down"), run.crowd.speed.T, strict=True))
    return _least_mean_greatest((run.crowd.values() | speeds)[column][rows], digits)


def _least_mean_greatest(values: np.ndarray, digits: int) -> tuple[str | None, ...]:
    if not len(values):
        return (None,) * 3
    return tuple(fixed(float(number), digits) for number in (values.min(), values.mean(), values.max()))
