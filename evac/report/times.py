"""The results of one run: who was out when, and the times of groups, exits, levels and stairs."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from operator import itemgetter

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.distributions import told
from evac.base.errors import in_order
from evac.pictures.colouring import colouring
from evac.report import figures
from evac.report.templates import APPENDIX, Section, fixed, section
from evac.results.answer import time_of_share
from evac.results.record import ExitUse, FlowUse, PlaceUse
from evac.results.results import Results

#: Shares of the people whose times are told [%].
SHARES = (5, 10, 25, 50, 75, 90, 95, 98, 100)


#: Greatest numbers of doors and of portals in the table of flows.
MOST_ROWS = 10


def times_section(run: Results) -> Section:
    """Return the section on the times of a run."""
    record, exit_time, leaving = run.record, run.crowd.exit_time, run.leaving
    left = leaving[np.isnan(exit_time[leaving])]
    motion = run.trajectory or None  # one without a recorded time shows nothing
    groups = [_group(one.name, exit_time[np.intersect1d(one.rows, leaving)]) for one in in_order(run.groups)]
    if len(groups) > 1 and run.evacuated:
        groups.append(_group("everybody", exit_time[leaving]))
    exits = []
    for index, (name, use) in enumerate(record.exits.items()):
        times = exit_time[run.crowd.exit_used == index]
        first = fixed(float(times.min()), 1) if times.size else None
        exits.append((name, use.people, first, fixed(use.last_out, 1), *_width_and_flows(use)))
    levels = Counter(one.level for one in record.stuck)
    return section(
        "times",
        "Course and evacuation times",
        course=figures.course(motion, exit_time[leaving]) if motion else [],
        looks=colouring(motion, "group").legend if motion else (),
        inside=figures.inside(motion, left) if motion and len(left) else None,
        stuck=[(name, levels[name]) for name in record.levels if levels[name]],
        curve=figures.egress(run),
        shares=[
            (f"{share} %", math.ceil(share / 100.0 * len(leaving)), _time_of(share, exit_time[leaving]))
            for share in SHARES
        ],
        groups=groups,
        exits=in_order(exits, itemgetter(0)),
        others=record.left_by_other_exits,
        metrics=[(name, told(values)) for name, values in record.metrics.items()],
    )


def _flow_rows(flows: Sequence[FlowUse]) -> list[tuple[object, ...]]:
    """Return the rows of lines and doors, and of the portals with the greatest specific flows."""
    portals = [use for use in flows if use.kind == "portal" and use.flow_per_metre is not None]
    portals.sort(key=lambda use: -(use.flow_per_metre or 0.0))
    chosen = [use for use in flows if use.kind == "line"] + [use for use in flows if use.kind == "door"][:MOST_ROWS]
    return [
        (use.kind, use.name, use.direction, use.people, *_width_and_flows(use))
        for use in [*chosen, *portals[:MOST_ROWS]]
    ]


def places_section(run: Results, id_: str = "places", name: str = "") -> Section:
    """Return the appendix with the use of levels and stairs, and flows through lines, of a run with a name."""

    def rows(places: Mapping[str, PlaceUse]) -> list[tuple[object, ...]]:
        return [
            (name, use.people, use.greatest_number, fixed(use.last_left, 1) or ("not cleared" if use.people else None))
            for name, use in places.items()
        ]

    inner = {level.name for level in run.trajectory.building.levels if level.stair} if run.trajectory else set()
    return section(
        id_,
        f"{APPENDIX}{name}levels, stairs and flows",
        "places.html",
        run=run,
        levels=[row for row in rows(run.record.levels) if row[0] not in inner],
        stairs=rows(run.record.stairs),
        flows=_flow_rows(run.record.flows),
    )


def _width_and_flows(use: FlowUse | ExitUse) -> tuple[str | None, ...]:
    return tuple(fixed(number, 2) for number in (use.width, use.flow, use.flow_per_metre))


def _time_of(share: float, times: FloatArray) -> str:
    return fixed(time_of_share(times, share), 1) or "not reached"


def _group(name: str, times: FloatArray) -> tuple[object, ...]:
    """Return the row of people with some exit times."""
    out = times[np.isfinite(times)]
    first, mean = (fixed(float(time), 1) for time in (out.min(), out.mean())) if out.size else (None, None)
    shares = [_time_of(share, times) for share in (50, 95, 100)] if times.size else [None] * 3
    return name, times.size, out.size, first, mean, *shares
