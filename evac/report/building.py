"""The building and its levels: plans, and tables of all that has a name."""

import math

from evac.building.model.building import Building
from evac.report import figures
from evac.report.html import Html, Section, counted, fixed, heading, paragraph, table
from evac.results.results import Results


def building_section(run: Results | None) -> Section:
    """Return the section on the building that a run recorded; without one, what the author has to add."""
    if run is None or run.trajectory is None:
        missing = (
            "No trajectory was recorded, and the building is part of that file. The plans and tables of levels, exits"
            " and portals are therefore missing here and must be added by the author."
        )
        if run is None:
            missing = (
                "A study does not store the plan of its building. With the option --run RESULT, where RESULT is the"
                " result of one of its runs, this report contains the plans, the times of levels and stairs, congestion"
                " and maps of that run."
            )
        return Section("building", "Building", (paragraph(missing),), is_missing=True)
    building = run.trajectory.building
    levels, portals = building.levels, building.portals
    parts = [
        paragraph(
            f"Read from {building.source.name}: {counted(len(levels), 'level')},"
            f" {counted(len(building.stairs), 'stair')}, {counted(len(building.exits), 'exit')},"
            f" {counted(len(portals), 'portal')} between levels,"
            f" {counted(len(building.areas), 'area')};"
            f" {sum(level.polygon.area for level in levels):.1f} m² of floor in plan."
        ),
        figures.plans(building),
        _levels(building),
        table(
            "Exits, with clear widths",
            ("exit", "level", "clear width [m]", "state"),
            [(e.name, levels[e.level].name, fixed(e.width, 2), _state(building.is_open(e))) for e in building.exits],
        ),
    ]
    if portals:
        rows = [
            (p.name, *(levels[k].name for k in p.levels), fixed(p.width, 2), _state(building.is_open(p)))
            for p in portals
        ]
        parts.append(table("Portals between levels", ("portal", "from", "to", "clear width [m]", "state"), rows))
    if building.doors:
        rows = [(door.name, levels[door.level].name, fixed(door.width, 2)) for door in building.doors]
        parts.append(table("Doors between rooms, with clear widths", ("door", "level", "clear width [m]"), rows))
    else:
        parts.append(
            paragraph(
                "The building file names no doors between rooms. If there are any, their clear widths must be added by"
                " the author."
            )
        )
    if building.areas:
        rows = [(area.name, levels[area.level].name, fixed(area.polygon.area, 1)) for area in building.areas]
        parts.append(table("Areas in which people can start", ("area", "level", "area [m²]"), rows))
    if closed := run.record.table.building.closed:
        parts += [heading("Closed during the whole run"), paragraph(", ".join(closed))]
    return Section("building", "Building", tuple(parts), lacks=() if building.doors else ("doors",))


def _levels(building: Building) -> Html:
    rows = [
        (
            level.name,
            level.kind,
            level.stair,
            fixed(level.z_min, 2),
            fixed(level.z_max, 2),
            fixed(math.degrees(level.slope), 1) if level.kind == "flight" else None,
            fixed(level.polygon.area, 1),
        )
        for level in building.levels
    ]
    columns = ("level", "kind", "stair", "lowest z [m]", "highest z [m]", "slope [°]", "area in plan [m²]")
    return table("Levels", columns, rows)


def _state(is_open: bool) -> str:
    return "open" if is_open else "closed"
