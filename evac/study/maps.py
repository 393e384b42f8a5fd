"""Maps over the runs of a study: those of each run, their means, and the shares of runs that go beyond a limit."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evac.analysis.congestion import DENSITY, Exceedance
from evac.analysis.maps import QUANTITIES, LevelMaps
from evac.base.arrays import FloatArray
from evac.building.model.cells import Cells
from evac.results.verdict import least_margins

if TYPE_CHECKING:
    from evac.results.results import Results
    from evac.study.study import Study

SPACING = 0.5  #: Distance of grid points of maps over runs [m].
MARGIN = "least_margin"  #: The least margin of the people whose margin was least in a cell [s].

#: Limits beyond which the share of runs is shown; margins are beyond theirs where they are less.
LIMITS = {"max_density": DENSITY, "waiting": 10.0, MARGIN: 0.0}


def maps_of(results: "Results") -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the maps of a recorded run (level, quantity, and values of all cells, row by row), and its congestion.

    Congestion is given as the numbers of a table (`evac.results.tables.numbers_of`).
    """
    trajectory, rows = results.trajectory, list[dict[str, Any]]()
    if trajectory is None or not len(trajectory):
        return [], []
    watched, margins = Exceedance(trajectory, spacing=SPACING), least_margins(results.margins, trajectory)
    for level in results.maps(watched).values():
        least, here = np.full(level.density.size, np.nan), [of for of in margins if of.level.index == level.index]
        if here:
            cells = Cells(trajectory.building.levels[level.index], SPACING)
            where = cells.cell(np.array([(of.x, of.y) for of in here]))
            np.fmin.at(least, where, [of.margin for of in here])
        maps = {name: level.array(name) for name in QUANTITIES} | ({MARGIN: least} if margins else {})
        rows += [
            {"level": level.level, "quantity": name, "values": values.ravel().astype(np.float32)}
            for name, values in maps.items()
        ]
    congestion = watched.congestion()
    numbers = {"greatest density [1/m²]": congestion.greatest_density, "longest at one place [s]": congestion.longest}
    return rows, [
        {"table": "congestion", "row": what, "column": "number", "value": number} for what, number in numbers.items()
    ]


class MapsOverRuns(NamedTuple):
    """What the maps of a level have over runs, each (ny, nx)."""

    maps: LevelMaps  # means over the runs in which a cell has a value; infinite where one of these is
    least_margin: FloatArray  # the same of the least margins [s]
    shares: Mapping[str, FloatArray]  # of runs beyond each of the `LIMITS` [%]; NaN off the floor


def maps_over_runs(study: "Study", point: int) -> Mapping[str, MapsOverRuns]:
    """Return the maps over the runs of a point by level; empty if none were made."""
    building, runs, end = study.building(point), 0, 0.0
    sums: dict[tuple[str, str], FloatArray] = {}  # (3, cells): sum, runs with a value, and runs beyond the limit
    for row in study.rows(point, ["maps", "time"]):
        runs, end = runs + bool(row["maps"]), max(end, row["time"])
        for grid in row["maps"] or ():
            name, values = grid["quantity"], np.array(grid["values"], np.float64)
            limit = LIMITS.get(name, math.inf)
            is_beyond = values < limit if name == MARGIN else values > limit
            own = sums.setdefault((grid["level"], name), np.zeros((3, len(values))))
            own += np.nan_to_num(values, posinf=math.inf), ~np.isnan(values), is_beyond
    if not runs or building is None:
        return {}
    by_level = {}
    for level in building.levels:
        cells = Cells(level, SPACING)
        nothing = np.zeros((3, math.prod(cells.shape)))
        total, known, beyond = (
            dict(zip((*QUANTITIES, MARGIN), part.reshape(-1, *cells.shape), strict=True))
            for part in np.stack([sums.get((level.name, name), nothing) for name in (*QUANTITIES, MARGIN)], axis=1)
        )
        with np.errstate(invalid="ignore"):
            means = {name: total[name] / known[name] for name in total}
        maps = LevelMaps(
            level=level.name,
            index=level.index,
            spacing=SPACING,
            origin=cells.origin,
            start=0.0,
            end=end,
            **{name: means[name] for name in QUANTITIES},
        )
        floor = np.where(np.isnan(maps.density), np.nan, 100.0 / runs)
        by_level[level.name] = MapsOverRuns(maps, means[MARGIN], {name: floor * beyond[name] for name in LIMITS})
    return by_level
