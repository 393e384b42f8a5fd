"""The sections of a report on one run, from the building to the hydraulic calculation."""

import base64
import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import shapely

from evac.analysis.congestion import DENSITY, SHARE, Exceedance
from evac.analysis.hydraulic import LABORATORY, DesignFlow
from evac.analysis.maps import KERNEL_RADIUS
from evac.base.change import Change, changes_in_words
from evac.base.distributions import as_text
from evac.base.errors import counted, in_order
from evac.base.toml import case_text
from evac.building.model.building import Area, Building
from evac.building.model.links import states_of
from evac.contract.hooks import BASES, DEFAULT_MOVEMENT
from evac.people.starts import load_table
from evac.pictures.palette import colouring
from evac.report import figures
from evac.report.pages import APPENDIX, BADGES, Cell, Section, fixed, section
from evac.results.recordedcase import BuildingTable, CaseTable, GroupTable
from evac.results.results import Results
from evac.results.verdict import BY, judged, least_margins, movement_of


def building_section(run: Results) -> Section:
    """Return the section on the building that a run recorded; without one, what the author has to add."""
    motion = run.trajectory
    if motion is None:
        return plan_section(None, (), run.case_table.building)
    return plan_section(motion.building, motion.changes, run.case_table.building)


def plan_section(building: Building | None, changes: Sequence[Change], case: BuildingTable) -> Section:
    """Return the section on a building and what changes in it."""
    if building is None:
        return section("building", "Building", building=None, is_missing=True)
    levels = building.levels
    states = [_in_words(changes) for changes in states_of(building, changes)]
    for link, control in building.controlled.items():
        states[link] += f"; {control}"
    return section(
        "building",
        "Building",
        building=building,
        mesh=case.mesh,
        ground=sum(level.polygon.area for level in levels),
        plans=figures.plans(building),
        stairs=[*_stairs(building)],
        exits=[
            (e.name, levels[e.level].name, fixed(e.width, 2), states[building.link_of(e)])
            for e in in_order(building.exits)
        ],
        doors=_alike(
            (levels[door.level].name, fixed(door.width, 2), states[building.link_of(door)], door.name)
            for door in in_order(building.doors)
        ),
        areas=_alike(
            (levels[area.level].name, fixed(area.polygon.area, 1), area.name)
            for area in sorted(in_order(building.areas), key=lambda area: area.level)
        ),
        places=[
            (place.name, place.kind, levels[place.level].name, place.area or place.exit, place.use)
            for place in building.places
        ],
        closed=case.closed,
        changes=[(fixed(time, 1), words) for time, words in changes_in_words(changes)],
        lacks=() if building.doors else ("doors",),
    )


def levels_section(building: Building, changes: Sequence[Change] = ()) -> Section:
    """Return the appendix with the levels of a building and their portals, without those of stairs that stay open."""
    levels, states = building.levels, [_in_words(changes) for changes in states_of(building, changes)]
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
            (p.name, *(levels[k].title for k in p.levels), fixed(p.width, 2), states[p.index])
            for p in building.portals
            if all(levels[k].stair is None for k in p.levels)
            or (states[p.index] != "open" and len({levels[k].title for k in p.levels}) > 1)
        ],
    )


def _alike(rows: Iterable[tuple[str | None, ...]]) -> list[tuple[object, ...]]:
    """Return one row for all those that differ only in the name at their end, with their number and names."""
    names: dict[tuple[str | None, ...], list[str]] = {}
    for *alike, name in rows:
        names.setdefault(tuple(alike), []).append(str(name))
    return [(*alike, len(own), ", ".join(own)) for alike, own in names.items()]


def _stairs(building: Building) -> Iterator[tuple[object, ...]]:
    """Yield a row for alike stairs above each other: names, heights, flights, steepest slope, and narrowest portal."""
    for shaft in building.shafts.values():
        for alike, own in groupby(shaft, lambda name: _stair(building, name)):
            names = [*own]
            levels = [building.levels[index] for name in names for index in building.stairs[name]]
            heights = min(level.z_min for level in levels), max(level.z_max for level in levels)
            yield " to ".join(dict.fromkeys([names[0], names[-1]])), *(fixed(z, 2) for z in heights), *alike


def _stair(building: Building, name: str) -> tuple[object, ...]:
    """Return of a stair its flights, steepest slope, and narrowest portal."""
    parts = [building.levels[index] for index in building.stairs[name]]
    flights = [level for level in parts if level.kind == "flight"]
    widths = [portal.width for level in parts for portal in building.portals_of(level.index)]
    slope = fixed(math.degrees(max((level.slope for level in flights), default=0.0)), 1)
    return len(flights), slope, fixed(min(widths, default=None), 2)


def _in_words(states: Sequence[tuple[float, bool]]) -> str:
    """Say whether a link is open at the start, and from which times on that changes."""
    words = [("open" if is_open else "closed", time) for time, is_open in states]
    return ", ".join([words[0][0], *(f"{word} from {time:g} s on" for word, time in words[1:])])


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


def occupants_section(
    case: CaseTable, building: Building | None, sizes: Mapping[str, int], run: Results | None
) -> Section:
    """Return the section on the occupants of a case with the sizes of its groups, and what a run has drawn."""
    enabled = {name: values for name, values in case.behaviours.items() if values is not False}
    responses = []
    if run is not None:
        starts = [(group.name, run.crowd.start_time[group.rows]) for group in in_order(run.groups)]
        responses = [(name, *_least_mean_greatest(times, 1)) for name, times in starts if len(times)]
    return section(
        "occupants",
        "Occupants and assumptions",
        people=sum(sizes.values()),
        fire=bool(case.conditions),
        groups=_groups(case, building, sizes),
        uses=_uses(building, run),
        characteristics=_characteristics(case, sizes, run),
        is_drawn=run is not None,
        behaviours=[(name, as_text(values)) for name, values in enabled.items()],
        settings=[
            (group.name, name, as_text(values))
            for group in in_order(case.people)
            for name, values in group.behaviours.items()
            if name in enabled
        ],
        responses=responses,
    )


def _groups(case: CaseTable, building: Building | None, sizes: Mapping[str, int]) -> list[tuple[object, ...]]:
    """Return name, number of people, start, density, exits and strategy of each group."""
    areas = {area.name: area.polygon.area for area in building.areas} if building else {}

    def row(group: GroupTable) -> tuple[object, ...]:
        size = None if group.arrive else areas.get(group.area or "")
        density = fixed(sizes[group.name] / size, 2) if size else None
        ways = (", ".join(group.exits) or "any exit") if group.leave else "they stay"
        if group.leave and group.assembly:
            ways = f"assembly area {', '.join(group.assembly)}"
        return group.name, sizes[group.name], _start(group), density, ways, group.strategy

    return [row(group) for group in in_order(case.people)]


def _uses(building: Building | None, run: Results | None) -> list[tuple[object, ...]]:
    """Return use, rooms, ground, people by the table of loads, people who start there, and source, of rooms by use."""
    areas = [area for area in building.areas if area.use] if building else []
    rows = list[tuple[object, ...]]()
    for use in sorted({area.use for area in areas}):
        own, load = [area for area in areas if area.use == use], load_table().get(use, {})
        ground, share = sum(room.polygon.area for room in own), load.get("ground")
        people = ground / share if share else 0.0
        numbers = fixed(ground, 1), fixed(share, 1), fixed(people, 0), _starting(own, run)
        rows.append((use, len(own), *numbers, load.get("source", "no load is known for this use")))
    return rows


def _starting(rooms: Sequence[Area], run: Results | None) -> str:
    """Return the number of people of a run who start in some rooms."""
    if run is None:
        return ""
    place, level = run.start_position.T, run.start_level
    there = [shapely.intersects_xy(room.polygon, *place) & (level == room.level) for room in rooms]
    return str(int(np.logical_or.reduce(there).sum()))


def _start(group: GroupTable) -> str:
    """Return where the people of a group start, or where and when they arrive."""
    on = f"level {group.level}" if group.level else f"z = {group.z:g} m" if group.z is not None else "a level"
    on = on if group.use is None else f"rooms of use {group.use}"
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


def _characteristics(case: CaseTable, sizes: Mapping[str, int], run: Results | None) -> list[dict[str, Any]]:
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
                "people": sum(sizes[group.name] for group in groups),
                "rows": [
                    (what, unit, as_text(given.get(name)), *_drawn(run, groups, name, digits))
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


def times_section(run: Results) -> Section:
    """Return the section on the times of a run."""
    exit_time, leaving = run.crowd.exit_time, run.leaving
    left = leaving[np.isnan(exit_time[leaving])]
    motion = run.trajectory or None  # one without a recorded time shows nothing
    stuck = Counter(place["level"] for place in run.stuck_places)
    return section(
        "times",
        "Course and evacuation times",
        course=figures.course(motion, exit_time[leaving]) if motion else [],
        looks=colouring(motion, "group").legend if motion else (),
        inside=figures.inside(motion, left) if motion and len(left) else None,
        stuck=list(stuck.items()),
        curve=figures.egress(run),
        tables=run.tables,
        others=run.number_by_other_exits,
        metrics=[(name, as_text(values)) for name, values in run.metrics.items()],
    )


def places_section(run: Results, id_: str = "places", name: str = "") -> Section:
    """Return the appendix with the use of levels and stairs, and flows through lines, of a run with a name."""
    return section(id_, f"{APPENDIX}{name}levels, stairs and flows", "places", run=run, tables=run.tables)


#: Greatest number of places in the table, those congested longest.
MOST_PLACES = 10

#: Greatest number of queues with a map and a curve, those in which people waited longest in total, and least share of
#: all waiting of those after the first.
MOST_QUEUES, LEAST_SHARE = 4, 0.05

TITLE, MARGINS = "Bottlenecks and congestion", "Available and required safe egress times"

#: The maps that a report has unless others are asked for.
MAPS = ("max_density", "waiting", "speed", "flow", "time_to_clear", "usage")


@dataclass(frozen=True)
class PlaceSettings:
    """What is shown of the places of a run."""

    density: float = DENSITY  # above which a place is congested [1/m2], see `evac.analysis.congestion.find_congestion`
    least_time: float | None = None  # for how long it has to be exceeded [s]; None: a tenth of the evacuation time
    maps: Sequence[str] = MAPS  # names of `evac.analysis.maps.QUANTITIES`, in order
    service: str = ""  # levels of service as colours of densities, see `evac.pictures.palette.SERVICES`


USUAL = PlaceSettings()


def congestion_sections(run: Results, places: PlaceSettings) -> tuple[Section, ...]:
    """Return the sections on bottlenecks and on maps."""
    trajectory = run.trajectory
    if trajectory is None or not len(trajectory):
        return (section("congestion", TITLE, congestion=None, is_missing=True),)
    least_time = places.least_time
    if least_time is None:
        least_time = SHARE * (run.last_out if run.is_complete and run.last_out else run.time)
    watched = Exceedance(trajectory, places.density)
    maps = run.maps(watched)
    congestion = watched.congestion(least_time)
    pictures = figures.map_pictures(trajectory, places.maps, maps, run.flows, places.service)
    return (
        section(
            "congestion",
            TITLE,
            congestion=congestion,
            others=len(congestion.places) - MOST_PLACES,
            radius=KERNEL_RADIUS,
            trajectory=trajectory,
            queues=[
                figures.bottleneck(trajectory, queue, maps, number)
                for number, queue in enumerate(run.queues[:MOST_QUEUES], 1)
                if number == 1 or queue.share >= LEAST_SHARE
            ],
            tables=run.tables,
            places=[
                (
                    str(number),
                    place.level,
                    place.near,
                    f"({place.x:.1f},\u00a0{place.y:.1f})",
                    fixed(place.area, 1),
                    fixed(place.density, 1),
                    f"{place.start:.1f}\u00a0to\u00a0{place.end:.1f}",
                    fixed(place.duration, 1),
                    fixed(place.longest_spell, 1),
                )
                for number, place in enumerate(congestion.places[:MOST_PLACES], 1)
            ],
        ),
        *([section("maps", f"{APPENDIX}maps", pictures=pictures, without=())] if pictures else []),
    )


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
        tables=run.tables,
    )


#: Greatest number of people with the least margins.
MOST_MARGINS = 10


def margins_section(run: Results) -> Section | None:
    """Return the section with available and required times by compartment; None if the case sets no limit."""
    if run.safety is None:
        return None
    all_ = least_margins(run.margins, run.trajectory) if run.trajectory else []
    names = run.group_names()
    worst = [
        (
            one.person,
            names[one.person],
            f"{one.margin:.1f}",
            f"{one.time:.1f}",
            one.level.title,
            f"({one.x:.1f}, {one.y:.1f})",
        )
        for one in all_[:MOST_MARGINS]
    ]
    return section(
        "margins",
        MARGINS,
        rows=safety_cells(run.safety),
        factor=run.safety["factor"],
        worst=worst,
        picture=figures.margins(run.trajectory, all_) if run.trajectory and all_ else None,
    )


def safety_cells(safety: Mapping[str, Any]) -> list[tuple[object, ...]]:
    """Return the cells of compartments to which people belong: required and available time, criterion, and margins."""
    return [
        (
            row["name"],
            str(row["people"]),
            (fixed(row["required"], 1) or "not left by all") + row.get("spread", ""),
            ("at least " if row["available"] is None else "") + f"{row['limit']:.1f}",
            BY.get(row["criterion"]),
            *(Cell(fixed(row[name], 1) or "none", BADGES[row["status"]]) for name in ("margin", "margin_with_factor")),
            fixed(row["least_margin"], 1),
        )
        for row in judged(safety)
    ]


#: Greatest number of lines of a case that is printed, on one or two pages.
MOST_LINES = 300


def model_section(
    case: CaseTable, versions: Mapping[str, str], plugins: Sequence[str], seed: str, command: str
) -> Section:
    """Return the section on the model."""
    return section(
        "model",
        f"{APPENDIX}model, parameters and versions",
        case=case,
        seed=seed,
        parameters={key: as_text(value) for key, value in case.model_parameters.items()},
        forces={name: as_text(values) for name, values in case.forces.items() if values is not False},
        versions=versions,
        plugins=plugins,
        command=command,
    )


def case_section(case: Mapping[str, Any]) -> Section:
    """Return the appendix with the whole case, which is attached to the page, and printed if it is short."""
    text = case_text(case)
    data = text.encode("utf-8")
    return section(
        "case",
        f"{APPENDIX}the case",
        text=text,
        lines=text.count("\n"),
        is_printed=text.count("\n") <= MOST_LINES,
        file=base64.b64encode(data).decode(),
        digest=hashlib.sha256(data).hexdigest(),
    )


#: Greatest number of rows of the hydraulic calculation; those with the longest times.
MOST_ROWS = 25


def design_section(run: Results) -> Section:
    """Return the section on design flows."""
    if run.building_or_none is None:
        return section("design", f"{APPENDIX}hydraulic calculation", "design_missing", is_missing=True)
    shown = sorted(run.design_flows, key=lambda flow: -flow.hydraulic_time)[:MOST_ROWS]
    rows, answer = [_design_row(flow) for flow in shown], hydraulic_answer(run)
    return section("design", f"{APPENDIX}hydraulic calculation", rows=rows, answer=answer, laboratory=LABORATORY)


def walking_of(case: CaseTable, keepers: Sequence[str]) -> str:
    """Return whether people keep distances, by the behaviours with which they do, and which basis walking has."""
    basis = str((case.behaviours.get(DEFAULT_MOVEMENT) or {}).get("preset"))
    return movement_of(keepers) + (f"; preset {basis!r}: {BASES[basis]}" if basis in BASES else "")


def hydraulic_answer(run: Results) -> str:
    """Return the hydraulic evacuation time beside that of the run, and where the run has more than hydraulic flows."""
    if run.building_or_none is None:
        return "Not computed, since no trajectory was recorded"
    if (decisive := run.hydraulic) is None:
        return "Nobody passed an exit, a door or a stair"
    time, own = decisive.hydraulic_time, "in the run, not everybody left"
    if run.last_out is not None and run.is_complete:
        change = round(100.0 * (run.last_out / time - 1.0))
        apart = f"{abs(change)} % {'less' if change < 0 else 'more'}" if change else "less than 1 % from it"
        own = f"that of the run is {run.last_out:.1f} s, {apart}"
    above = run.above_design
    most = f", most at {above[0][1].kind} {above[0][1].name!r}, by {100.0 * (above[0][0] - 1.0):.0f} %" if above else ""
    return (
        f"The hydraulic evacuation time is {time:.1f} s, determined by the "
        f"{counted(decisive.people, 'person', 'people')}, each counted once, who pass {decisive.kind} "
        f"{decisive.name!r}; {own}. "
        f"{counted(len(above), 'place')} of {len(run.design_flows)} had more than the hydraulic flow{most}"
    )


def _design_row(flow: DesignFlow) -> tuple[object, ...]:
    people = Cell(str(flow.people), "bad") if flow.people > flow.capacity else str(flow.people)
    flows = [fixed(number, 2) for number in (flow.flow, flow.hydraulic_flow, flow.ratio, flow.laboratory_flow)]
    last = str(flow.capacity), fixed(flow.hydraulic_time, 1)
    return flow.kind, flow.name, fixed(flow.width, 2), people, *flows, *last
