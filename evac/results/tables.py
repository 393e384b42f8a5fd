"""The tables of numbers of a run, which its report shows, and the report of a study over its runs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evac.analysis.congestion import DENSITY
from evac.analysis.lines import ExitUse, FlowUse, Occupancy
from evac.base.arrays import FloatArray
from evac.base.change import LIFT
from evac.base.errors import in_order
from evac.results.verdict import time_of_share

if TYPE_CHECKING:
    from evac.results.results import Results

SHARES = (5, 10, 25, 50, 75, 90, 95, 98, 100)  #: Shares of the people whose times are told [%].
MOST_FLOWS = 10  #: Greatest numbers of doors, of portals and of queues.


class TableForm(NamedTuple):
    """What a table is."""

    caption: str
    head: tuple[str, ...]
    never: str = ""  # what infinity, the time of what did not happen, is called


USED = ("people who used it", "maximum number at one time", "last left [s]")
FLOW = ("width [m]", "flow [1/s]", "per metre [1/(m s)]")

#: The tables, by name, in the order of reports.
TABLES = {
    "shares": TableForm("Times at which a share of the people was out", ("share", "people", "time [s]"), "not reached"),
    "groups": TableForm(
        "Times at which people of each group left; the mean is over those who left",
        ("group", "people", "out", "first [s]", "mean [s]", "50 % [s]", "95 % [s]", "all [s]"),
        "not reached",
    ),
    "exits": TableForm(
        "Exits; the flow is that between the first and the last fifth of the people, if 20 or more left by the exit",
        ("exit", "people", "share of all out [%]", "first [s]", "last [s]", *FLOW),
    ),
    "phases": TableForm(
        "Phases: people who started in their places, with the alarm and the times at which they started and were out",
        ("phase", "places", "people", "alarm [s]", "first starts [s]", "last starts [s]", "last out [s]"),
    ),
    "cleared": TableForm(
        "Times at which nobody was left on the floors of each phase", ("phase", "floor", "clear [s]"), "not clear"
    ),
    "queues": TableForm(
        "Queues by what causes them, those with the longest total waiting time",
        ("cause", "share of all waiting [%]", "people", "mean wait [s]", "most at once", "from [s]", "to [s]"),
    ),
    "congestion": TableForm(
        f"Densities above {DENSITY:g} people per m²",
        ("what", "number"),  # of recorded runs of studies
    ),
    "doses": TableForm("Doses of people", ("dose", "people above 0.3", "people above 1", "greatest")),
    "outcomes": TableForm("Hydraulic calculation, events, safe places, smoke, doses and margins", ("what", "number")),
    "levels": TableForm("Use, and time at which the last person left", ("level", *USED), "not cleared"),
    "stairs": TableForm(
        "Use of stairs, flights and landings together, and time at which the last person left",
        ("stair", *USED),
        "not cleared",
    ),
    "merging": TableForm(
        "Stairs that people enter from a floor and from other stairs; the share is that of the floor while both came",
        ("stair", "floor", "people from stairs", "people from the floor", "share of the floor [%]"),
    ),
    "lifts": TableForm(
        "Lifts; by hand: the time in which the cars of its bank bring as many people down, 10 % longer than full trips",
        (
            *("lift", "trips", "people", "mean load [%]", "mean wait [s]", "longest wait [s]"),
            *("last ride ends [s]", "by hand [s]"),
        ),
    ),
    "flows": TableForm(
        "Lines of the case, doors, and the portals with the greatest specific flows; flows.csv has all of them over"
        " time",
        ("kind", "name", "direction", "passages", *FLOW),
    ),
}

HYDRAULIC = "hydraulic evacuation time [s]"  #: Row of the outcomes with the time of the hydraulic calculation.

#: Row of the outcomes with the waiting of all people together, if their motion was recorded.
WAITED = "waiting of all people [s]"

AT = "people at "  #: What the row of the outcomes with the number of people at a safe place begins with.
Rows = list[tuple[Any, ...]]  #: Rows of a table: words, and numbers, None where there is none.


def tables_of(run: "Results") -> dict[str, Rows]:
    """Return the rows of the `TABLES` of a run."""
    leaving, exit_time = run.leaving, run.crowd.exit_time
    groups = [_group(group.name, exit_time[np.intersect1d(group.rows, leaving)]) for group in in_order(run.groups)]
    if len(groups) > 1 and run.evacuated:
        groups.append(_group("everybody", exit_time[leaving]))
    times = ("alarm", "first_start", "last_start", "last_out")
    dose = (run.conditions or {}).get("dose")
    return {
        "shares": [
            (f"{share} %", math.ceil(share / 100.0 * len(leaving)), _time_of(share, exit_time[leaving]))
            for share in SHARES
        ],
        "groups": groups,
        "exits": in_order(_exits(run), itemgetter(0)),
        "phases": [
            (phase["name"], ", ".join(phase["of"]), phase["people"], *(phase[name] for name in times))  # type: ignore[literal-required]
            for phase in run.phase
        ],
        "cleared": [
            (phase["name"], floor, math.inf if time is None else time)
            for phase in run.phase
            for floor, time in phase["clear"].items()
        ],
        "lifts": [
            (
                *(one["name"], one["trips"], one["people"], 100.0 * (one["mean_load"] or 0.0), one["mean_wait"]),
                *(one["longest_wait"], one["last_ride"], one["by_hand"]),
            )
            for one in run.lifts
        ],
        "queues": [
            (
                *(queue.place, 100.0 * queue.share, queue.people, queue.waited / queue.people),
                *(queue.most, queue.start, queue.end),
            )
            for queue in run.queues[:MOST_FLOWS]
        ],
        "doses": [
            (f"of {what}", dose[f"{kind}_above_0.3"], dose[f"{kind}_above_1"], dose[f"greatest_{kind}"])
            for kind, what in (("gas", "gases"), ("heat", "heat"))
        ]
        if dose
        else [],
        "outcomes": list(_outcomes(run)),
        "levels": _used(run.levels),
        "stairs": _used(run.stairs),
        "merging": in_order(_merging(run), itemgetter(0)),
        "flows": _flows(run.flow_totals),
    }


def numbers_of(run: "Results") -> Iterator[dict[str, Any]]:
    """Yield the numbers in the tables of a run: table, words of the row, head of the column, and value."""
    for table, rows in run.tables.items():
        for row in rows:
            words = ", ".join(cell for cell in row if isinstance(cell, str))
            for column, cell in zip(TABLES[table].head, row, strict=True):
                if isinstance(cell, int | float) and (table, column) != ("shares", "people") and column != FLOW[0]:
                    yield {"table": table, "row": words, "column": column, "value": float(cell)}


def _group(name: str, times: FloatArray) -> tuple[Any, ...]:
    """Return the row of people with some exit times."""
    out = times[np.isfinite(times)]
    first, mean = (float(out.min()), float(out.mean())) if out.size else (None, None)
    shares = [_time_of(share, times) for share in (50, 95, 100)] if times.size else [None] * 3
    return name, times.size, out.size, first, mean, *shares


def _time_of(share: float, times: FloatArray) -> float:
    time = time_of_share(times, share)
    return math.inf if time is None else time


def _exits(run: "Results") -> Iterator[tuple[Any, ...]]:
    for index, (name, use) in enumerate(run.exits.items()):
        times = run.crowd.exit_time[run.crowd.exit_used == index]
        first, share = float(times.min()) if times.size else None, 100.0 * use["people"] / max(run.evacuated, 1)
        yield name, use["people"], share, first, use["last_out"], *_width_and_flows(use)


def _outcomes(run: "Results") -> Iterator[tuple[str, float | None]]:
    """Yield what has a number in a run, or none."""
    if run.hydraulic is not None:
        yield HYDRAULIC, run.hydraulic.hydraulic_time
        yield "places with more than the hydraulic flow", len(run.above_design)
    if run.trajectory is not None:
        yield WAITED, sum(queue.waited for queue in run.queues)
    yield "people stopped by gases or heat", len(run.stopped)
    for place in run.places:
        yield f"{AT}{place}", len(place.people)
        yield f"last arrival at {place} [s]", place.last
    doses = [run.exposure[name] for name in ("gas_dose", "heat_dose") if name in run.exposure]
    if run.conditions is not None:
        yield "greatest extinction coefficient at a head [1/m]", run.conditions["greatest_extinction"]
    if run.conditions is not None and run.conditions["dose"]:
        yield "greatest dose", float(np.max(doses, initial=0.0))
    for change in (change for change in run.changes if change.kind != LIFT):
        yield f"{change.words}, at [s]", change.time
    for compartment in (run.safety or {}).get("compartments", ()):
        yield f"least margin of a person in {compartment['name']!r} [s]", compartment["least_margin"]


def _used(places: Mapping[str, Occupancy]) -> Rows:
    never = {name: math.inf if use["people"] else None for name, use in places.items()}
    return [
        (name, use["people"], use["greatest_number"], never[name] if use["last_left"] is None else use["last_left"])
        for name, use in places.items()
    ]


def _merging(run: "Results") -> Iterator[tuple[Any, ...]]:
    """Yield each stair with a floor from which people entered it, some of whom had come there by other stairs."""
    if run.building_or_none is None:
        return
    names, ways = [level.stair or level.title for level in run.building.levels], list[tuple[int, float, str, str]]()
    for line in (line for line in run.flows if line.kind == "portal"):
        first, second = (names[level] for level in line.levels)
        for person, time, forward in zip(line.person, line.time, line.forward, strict=True):
            ways.append((int(person), float(time), *((first, second) if forward else (second, first))))
    came = dict[tuple[str, str], tuple[list[float], list[float]]]()  # times of those from stairs, and of the others
    paths = dict[int, list[tuple[str, float]]]()  # places through which each person came, and since when
    for person, time, old, new in sorted(ways):
        path = paths.setdefault(person, [(old, 0.0)])
        if len(path) > 1 and path[-2][0] == new:
            path.pop()  # who turns back, or sways on an edge, did not pass it
        elif old != new:
            path.append((new, time))
    for path in paths.values():
        on_stair = [place in run.stairs for place, _ in path]
        for k in (k for k in range(1, len(path)) if on_stair[k] and not on_stair[k - 1]):
            came.setdefault((path[k][0], path[k - 1][0]), ([], []))[not any(on_stair[:k])].append(path[k][1])
    for place, both in came.items():
        if all(both):
            since, until = max(map(min, both)), min(map(max, both))
            stairs, floor = (sum(since <= time <= until for time in times) for times in both)
            yield *place, *map(len, both), 100.0 * floor / (stairs + floor) if floor else None


def _flows(flows: Sequence[FlowUse]) -> Rows:
    """Return the rows of lines and doors, and of the portals with the greatest specific flows."""
    portals = [use for use in flows if use["kind"] == "portal" and use["flow_per_metre"] is not None]
    portals.sort(key=lambda use: -(use["flow_per_metre"] or 0.0))
    doors = [use for use in flows if use["kind"] == "door"][:MOST_FLOWS]
    chosen = [use for use in flows if use["kind"] == "line"] + doors
    return [
        (use["kind"], use["name"], use["direction"], use["people"], *_width_and_flows(use))
        for use in [*chosen, *portals[:MOST_FLOWS]]
    ]


def _width_and_flows(use: FlowUse | ExitUse) -> tuple[float | None, ...]:
    return use["width"], use["flow"], use["flow_per_metre"]
