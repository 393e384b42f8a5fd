"""The building and its levels: plans, and tables of all that has a name."""

import math

from evac.report import figures
from evac.report.templates import Section, fixed, section
from evac.results.results import Results


def building_section(run: Results | None) -> Section:
    """Return the section on the building that a run recorded; without one, what the author has to add."""
    if run is None or run.trajectory is None:
        return section("building", "Building", building=None, has_run=run is not None, is_missing=True)
    building = run.trajectory.building
    levels = building.levels

    def state(is_open: bool) -> str:
        return "open" if is_open else "closed"

    return section(
        "building",
        "Building",
        building=building,
        ground=sum(level.polygon.area for level in levels),
        plans=figures.plans(building),
        levels=[
            (
                level.name,
                level.kind,
                level.stair,
                fixed(level.z_min, 2),
                fixed(level.z_max, 2),
                fixed(math.degrees(level.slope), 1) if level.kind == "flight" else None,
                fixed(level.polygon.area, 1),
            )
            for level in levels
        ],
        exits=[(e.name, levels[e.level].name, fixed(e.width, 2), state(building.is_open(e))) for e in building.exits],
        portals=[
            (p.name, *(levels[k].name for k in p.levels), fixed(p.width, 2), state(building.is_open(p)))
            for p in building.portals
        ],
        doors=[(door.name, levels[door.level].name, fixed(door.width, 2)) for door in building.doors],
        areas=[(area.name, levels[area.level].name, fixed(area.polygon.area, 1)) for area in building.areas],
        closed=run.record.table.building.closed,
        lacks=() if building.doors else ("doors",),
    )
