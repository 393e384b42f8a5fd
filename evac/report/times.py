"""The results of one run: who was out when, and the times of groups, exits, levels and stairs."""

import math

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import counted
from evac.report import figures
from evac.report.html import Html, Section, fixed, heading, paragraph, table
from evac.results.record import PlaceUse
from evac.results.results import Results

#: Shares of the people whose times are told [%].
SHARES = (5, 10, 25, 50, 75, 90, 95, 98, 100)


def time_of_share(exit_time: FloatArray, percent: float) -> float | None:
    """Return when so many per cent of all people were out [s]; None if that many never were.

    Parameters
    ----------
    exit_time : (n,) float64 [s]
        NaN for people who are not out.
    percent : float
    """
    rank = max(math.ceil(percent / 100.0 * exit_time.size), 1)
    out = np.sort(exit_time[np.isfinite(exit_time)])
    return float(out[rank - 1]) if rank <= out.size else None


def times_section(run: Results) -> Section:
    """Return the section on the times of a run."""
    summary = run.record
    exit_time = run.crowd.exit_time
    rows = {group.name: group.rows for group in run.groups}
    curves = {name: run.egress(members) for name, members in rows.items()}
    sizes = {name: len(members) for name, members in rows.items()}
    shares = [
        (f"{share} %", math.ceil(share / 100.0 * summary.people), _time(time_of_share(exit_time, share)))
        for share in SHARES
    ]
    parts = [
        heading("Egress curve"),
        figures.egress(summary.people, summary.simulated_time, run.egress(), curves, sizes),
        table(
            "Times at which a share of all people was out; it is reached with the first person that completes it",
            ("share", "people", "time [s]"),
            shares,
        ),
        heading("Groups"),
        _groups(run, exit_time, rows),
        heading("Exits"),
        _exits(run),
        *place_tables(run),
    ]
    if summary.left_by_other_exits:
        parts.append(
            paragraph(
                f"{counted(summary.left_by_other_exits, 'person', 'people')} left by an exit that does not belong to "
                "the route, for example after being pushed across its line."
            )
        )
    if summary.stuck:
        places = [(p.person, p.level, fixed(p.x, 2), fixed(p.y, 2)) for p in summary.stuck]
        parts += [
            heading("People who no longer made progress at the end"),
            table("Their positions", ("person", "level", "x [m]", "y [m]"), places),
        ]
    if summary.metrics:
        from evac.report.occupants import told

        parts += [
            heading("Metrics of plugins"),
            table(
                "As the plugins return them", ("plugin", "metric"), [(k, told(v)) for k, v in summary.metrics.items()]
            ),
        ]
    return Section("times", "Evacuation times", tuple(parts))


def place_tables(run: Results) -> list[Html]:
    """Return the tables of levels and stairs of a run."""
    summary = run.record
    parts = [heading("Levels"), _places("level", summary.levels)]
    if summary.stairs:
        parts += [heading("Stairs"), _places("stair, flights and landings together", summary.stairs)]
    return parts


def _time(value: float | None) -> str:
    return "not reached" if value is None else f"{value:.1f}"


def _groups(run: Results, exit_time: FloatArray, rows: dict[str, np.ndarray]) -> Html:
    lines = []
    for name, members in rows.items():
        times = exit_time[members]
        out = times[np.isfinite(times)]
        first = fixed(float(out.min()), 1) if out.size else None
        mean = fixed(float(out.mean()), 1) if out.size else None
        shares = [_time(time_of_share(times, share)) for share in (50, 95, 100)] if times.size else [None] * 3
        lines.append((name, times.size, out.size, first, mean, *shares))
    out = exit_time[np.isfinite(exit_time)]
    if len(rows) > 1 and out.size:
        shares = [_time(time_of_share(exit_time, share)) for share in (50, 95, 100)]
        lines.append(
            ("everybody", exit_time.size, out.size, fixed(float(out.min()), 1), fixed(float(out.mean()), 1), *shares)
        )
    columns = ("group", "people", "out", "first [s]", "mean [s]", "50 % [s]", "95 % [s]", "all [s]")
    return table("Times at which people of each group left; the mean is over those who are out", columns, lines)


def _exits(run: Results) -> Html:
    lines = []
    for index, (name, use) in enumerate(run.record.exits.items()):
        times = run.crowd.exit_time[run.crowd.exit_used == index]
        first = fixed(float(times.min()), 1) if times.size else None
        flows = fixed(use.width, 2), fixed(use.flow, 2), fixed(use.flow_per_metre, 2)
        lines.append((name, use.people, first, fixed(use.last_out, 1), *flows))
    caption = (
        "Exits; the flow is that between the first and the last fifth of the people, if 20 or more left by the exit"
    )
    columns = ("exit", "people", "first [s]", "last [s]", "width [m]", "flow [1/s]", "per metre [1/(m s)]")
    return table(caption, columns, lines)


def _places(what: str, places: dict[str, PlaceUse]) -> Html:
    rows = [
        (
            name,
            use.people,
            use.greatest_number,
            fixed(use.last_left, 1) if use.last_left is not None or not use.people else "not cleared",
        )
        for name, use in places.items()
    ]
    columns = (what, "people who used it", "maximum number at one time", "last left [s]")
    return table("Use, and time at which the last person left", columns, rows)
