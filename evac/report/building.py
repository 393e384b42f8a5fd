"""The building and its levels: plans, and tables of all that has a name."""

import math
from collections.abc import Iterable, Sequence

from evac.base.errors import in_order
from evac.building.model.building import Building
from evac.building.model.links import states_of
from evac.report import figures
from evac.report.templates import APPENDIX, Section, fixed, section
from evac.results.results import Results
from evac.trajectory.trajectory import Trajectory


def building_section(run: Results | None) -> Section:
    """Return the section on the building that a run recorded; without one, what the author has to add."""
    if run is None or run.trajectory is None:
        return section("building", "Building", building=None, has_run=run is not None, is_missing=True)
    building = run.trajectory.building
    levels = building.levels
    states = [_in_words(found) for found in states_of(building, run.trajectory.changes)]
    return section(
        "building",
        "Building",
        building=building,
        mesh=run.record.table.building.mesh,
        ground=sum(level.polygon.area for level in levels),
        plans=figures.plans(building),
        stairs=[_stair(building, name) for name in building.stairs],
        exits=[
            (e.name, levels[e.level].name, fixed(e.width, 2), states[building.link_of(e)])
            for e in in_order(building.exits)
        ],
        doors=_alike(
            (levels[door.level].name, fixed(door.width, 2), states[building.n_links + k], door.name)
            for k, door in in_order(enumerate(building.doors), lambda one: one[1].name)
        ),
        areas=_alike(
            (levels[area.level].name, fixed(area.polygon.area, 1), area.name)
            for area in sorted(in_order(building.areas), key=lambda area: area.level)
        ),
        places=[
            (place.name, place.kind, levels[place.level].name, place.area or place.exit, place.use)
            for place in building.places
        ],
        closed=run.record.table.building.closed,
        changes=[(fixed(change.time, 1), change.words) for change in run.trajectory.changes],
        lacks=() if building.doors else ("doors",),
    )


def levels_section(trajectory: Trajectory) -> Section:
    """Return the appendix with the levels of a building and their portals, without those of stairs that stay open."""
    building = trajectory.building
    levels, states = building.levels, [_in_words(found) for found in states_of(building, trajectory.changes)]
    return section(
        "levels",
        f"{APPENDIX}levels and portals",
        levels=[
            (
                level.name,
                level.kind,
                fixed(level.z_min, 2),
                fixed(level.z_max, 2),
                fixed(math.degrees(level.slope), 1) if level.kind == "flight" else None,
                fixed(level.polygon.area, 1),
            )
            for level in levels
            if level.stair is None
        ],
        portals=[
            (p.name, *(levels[k].name for k in p.levels), fixed(p.width, 2), states[p.index])
            for p in building.portals
            if states[p.index] != "open" or all(levels[k].stair is None for k in p.levels)
        ],
    )


def _alike(rows: Iterable[tuple[str | None, ...]]) -> list[tuple[object, ...]]:
    """Return one row for all those that differ only in the name at their end, with their number and names."""
    names: dict[tuple[str | None, ...], list[str]] = {}
    for *alike, name in rows:
        names.setdefault(tuple(alike), []).append(str(name))
    return [(*alike, len(found), ", ".join(found)) for alike, found in names.items()]


def _stair(building: Building, name: str) -> tuple[object, ...]:
    """Return the row of a stair: its heights, flights, steepest slope, and narrowest portal."""
    parts = [building.levels[index] for index in building.stairs[name]]
    flights = [level for level in parts if level.kind == "flight"]
    widths = [portal.width for level in parts for portal in building.portals_of(level.index)]
    return (
        name,
        fixed(min(level.z_min for level in parts), 2),
        fixed(max(level.z_max for level in parts), 2),
        len(flights),
        fixed(math.degrees(max((level.slope for level in flights), default=0.0)), 1),
        fixed(min(widths, default=None), 2),
    )


def _in_words(states: Sequence[tuple[float, bool]]) -> str:
    """Say whether a link is open at the start, and from which times on that changes."""
    words = [("open" if is_open else "closed", time) for time, is_open in states]
    return ", ".join([words[0][0], *(f"{word} from {time:g} s on" for word, time in words[1:])])
