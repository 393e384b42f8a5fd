"""Available and required times of compartments, and the margin of each person on its way."""

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.building.model.building import Area, Building
from evac.building.model.cells import CellIndex, LevelField, cell_at
from evac.conditions.dose import dose_rates, irritant_concentration, irritant_scale
from evac.conditions.source import IRRITANTS, QUANTITIES
from evac.jit import ByteGrid, Bytes, FloatGrid, Floats, Longs, Struct, Triples, kernel
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import CriteriaSettings, SafetySettings
    from evac.conditions.air import Air

#: Least side of the cells of floors [m], and least time between two readings of the air [s].
SPACING, PERIOD = 0.5, 1.0

WHOLE = "building"  #: Name of the compartment that is the whole building.
MOST_CELLS, MOST_READINGS = 50_000, 10_000_000  #: Greatest number of cells, and of cells times readings.

#: Criteria of the air, and the quantities of which they need one.
CRITERIA = {
    "visibility": ("extinction",),
    "temperature": ("temperature",),
    "fic": IRRITANTS,
    "layer": ("layer",),
    "fed": tuple(QUANTITIES),
}


@dataclass(frozen=True)
class Compartment:
    """A part of a building that must be left in time; everybody on one of its `stairs` (levels) belongs to it."""

    name: str
    levels: frozenset[int]
    stairs: frozenset[int]
    areas: tuple[Area, ...]
    without: tuple[Area, ...]
    everybody: bool
    limits: Mapping[str, float]
    share: float

    def floor(self, level: int, whole: shapely.Geometry) -> shapely.Geometry:
        """Return the part of a level, which has a whole polygon, with criteria."""
        own = whole if level in self.levels else _on(self.areas, level).intersection(whole)
        return own.difference(_on(self.without, level))


def _on(areas: Iterable[Area], level: int) -> shapely.Geometry:
    """Return the polygon of all areas on a level."""
    return shapely.union_all([shapely.Polygon(), *(area.polygon for area in areas if area.level == level)])


def _parts_in(polygon: shapely.Geometry, boxes: NDArray[np.object_]) -> NDArray[np.object_]:
    """Return the parts of boxes in a polygon, which cuts those alone that are not whole in it."""
    shapely.prepare(polygon)
    parts, cut = boxes.copy(), ~shapely.contains_properly(polygon, boxes)
    parts[cut] = shapely.intersection(boxes[cut], polygon)
    return parts


def compartments_of(case: "Case", settings: "SafetySettings", building: Building) -> list[Compartment]:
    """Return the compartments of a case with a table [safety]: those that it states, or each storey and stair.

    A time given by hand for all of these is one for the building, too. No other compartment counts until they are out
    those who come from above and walk through the ground floor.
    """
    if case.compartment:
        found = []
        for one in case.compartment:
            where = f"{case.source}: compartment.{one.name}"
            levels, stairs, areas = _parts(building, one.of or (one.name,), f"{where}.of")
            without = _parts(building, one.without, f"{where}.without")[2]
            limits, share = _limits(case, where, one, settings)
            found.append(Compartment(one.name, levels, stairs, areas, without, one.everybody, limits, share))
        return found
    limits, share = _limits(case, f"{case.source}: safety", settings)
    floors = {name: {level.index for level in levels if level.stair is None} for name, levels in building.storeys}
    parts = [(name, own, frozenset[int]()) for name, own in floors.items()]
    parts += [(name, set(own), frozenset(own)) for name, own in building.stairs.items()]
    found = [
        Compartment(name, frozenset(own), stairs, (), (), False, limits, share) for name, own, stairs in parts if own
    ]
    if "available" in limits and len(found) > 1:
        everywhere = frozenset[int]().union(*(one.levels for one in found))
        given = {"available": limits["available"]}
        found.append(Compartment(WHOLE, everywhere, frozenset(), (), (), True, given, share))
    return found


def _parts(
    building: Building, names: tuple[str, ...], where: str
) -> tuple[frozenset[int], frozenset[int], tuple[Area, ...]]:
    """Return the levels, those of them that are on stairs, and the areas with some names."""
    levels, stairs, areas = set[int](), set[int](), list[Area]()
    for name in names:
        own = [area for area in building.areas if area.name == name]
        if (level := building.level_named(name)) is not None:
            levels.add(level.index)
        elif name in building.stairs:
            stairs.update(building.stairs[name])
        elif own:
            areas += own
        else:
            known = [*(one.name for one in building.levels), *(one.name for one in building.areas), *building.stairs]
            raise ScenarioError(f"{where}: there is no level, stair or area {name!r}; {did_you_mean(name, known)}")
    if where.endswith("without"):
        areas += [Area(building.levels[k].name, k, building.levels[k].polygon) for k in levels | stairs]
    return frozenset(levels | stairs), frozenset(stairs), tuple(areas)


def _limits(case: "Case", where: str, *settings: "CriteriaSettings") -> tuple[dict[str, float], float]:
    """Return the criteria by name, of the first settings that have each, and the share of the floor."""

    def given(name: str) -> float | None:
        return next((value for one in settings if (value := getattr(one, name)) is not None), None)

    limits = {name: value for name in ("available", *CRITERIA) if (value := given(name)) is not None}
    if not limits:
        raise ScenarioError(f"{where}: has no criterion; add one, for example visibility = 10.0 or available = 180.0")
    if "fed" in limits and case.dose is None:
        raise ScenarioError(f"{where}.fed: the case computes no dose; add a table [dose], or remove fed")
    return limits, given("share") or 0.0


@dataclass(frozen=True)
class Floors:
    """The cells of the floors of compartments: level (cells,), a place (cells, 2) [m] in each, and the area [m2].

    `areas` (compartments, cells) has the area of each compartment in each cell, and `number` the cells of levels, with
    that of the floor in each, NaN where there is none.
    """

    level: IntArray
    place: FloatArray
    areas: FloatArray
    number: LevelField


def floors_of(compartments: Sequence[Compartment], building: Building) -> Floors:
    """Return the cells of the floors of compartments."""
    wanted = {*(k for one in compartments for k in one.levels), *(a.level for one in compartments for a in one.areas)}
    area = sum(building.levels[level].polygon.area for level in wanted)
    spacing = max(SPACING, math.sqrt(area / MOST_CELLS))
    number = LevelField(building, "first", "s", spacing)
    number.values = np.full(number.size, np.nan)
    places, level_of, cells = list[FloatArray](), list[IntArray](), 0
    areas: list[list[FloatArray]] = [[] for _ in compartments]
    for level in sorted(wanted):
        whole, grid = building.levels[level].polygon, number.cells[level]
        x, y = (values.ravel() - 0.5 * spacing for values in grid.centres())
        boxes = shapely.box(x, y, x + spacing, y + spacing)
        pieces = _parts_in(whole, boxes)
        own = np.flatnonzero(shapely.area(pieces) > 0.0)
        inner = shapely.point_on_surface(pieces[own])
        places.append(np.column_stack([shapely.get_x(inner), shapely.get_y(inner)]))
        level_of.append(np.full(len(own), level, np.int32))
        number.on(level).ravel()[own] = cells + np.arange(len(own))
        cells += len(own)
        for one, parts in zip(compartments, areas, strict=True):
            parts.append(shapely.area(_parts_in(one.floor(level, whole), boxes[own])))
    return Floors(
        np.concatenate(level_of), np.concatenate(places), np.array([np.concatenate(parts) for parts in areas]), number
    )


class Safety(Saved):
    """Finds when compartments become unsafe, when people leave them, and how much time each person has left.

    A criterion is met at a place from the first time on at which it is met there, at the mean height of heads, also if
    the air becomes better later. It is read on cells of floors every few seconds, and is linear in between. The margin
    of a person is the time at which a criterion of a compartment, with the own dose, would be met where it is, minus
    the present time: `least` (n,) [s] so far, inf if none is met on its way, at the time `least_at` (n,) [s].
    """

    saved = ("least", "least_at", "left", "_seen", "_belongs", "_reached", "_of_compartments")

    def __init__(
        self,
        case: "Case",
        settings: "SafetySettings",
        building: Building,
        crowd: Crowd,
        air: "Air | None",
        exempt: IntArray,
        known: dict[Hashable, Floors],
    ) -> None:
        self._case, self._settings, self._crowd, self._air = case, settings, crowd, air
        self.compartments = compartments_of(case, settings, building)
        n, number = len(crowd.level), len(self.compartments)
        self._leaves = np.ones(n, np.bool_)
        self._leaves[exempt] = False
        self.least, self.least_at = np.full(n, np.inf), np.full(n, np.nan)
        # (compartments, n) [s]: inf for those who are there, NaN for those who do not belong to it
        self.left = np.full((number, n), np.nan)
        self._seen, self._belongs = np.zeros(n, np.bool_), np.zeros((number, n), np.bool_)
        # Doses that are criteria, and when the own dose of each person has reached each of them.
        self._doses_to_reach = sorted({one.limits["fed"] for one in self.compartments if "fed" in one.limits})
        self._reached = np.full((len(self._doses_to_reach), n), np.inf)
        self._of_compartments = np.full((number, 3), np.nan)  # least margin in each, person, time
        self._of_compartments[:, 0] = np.inf
        numbers = range(len(building.levels))
        self._on, self._on_stairs = (
            np.array([[level in levels for level in numbers] for levels in of], np.bool_)
            for of in ([one.levels for one in self.compartments], [one.stairs for one in self.compartments])
        )
        self._presence = Presence(
            on=self._on.view(np.uint8),
            on_stairs=self._on_stairs.view(np.uint8),
            everybody=np.array([one.everybody for one in self.compartments], np.uint8),
            leaves=np.zeros(n, np.uint8),
            in_areas=np.zeros((number, n), np.uint8),
            seen=self._seen.view(np.uint8),
            belongs=self._belongs.view(np.uint8),
            left=self.left,
        )
        self._check_quantities()
        parts = tuple((one.levels, one.areas, one.without) for one in self.compartments)
        if parts not in known:
            known[parts] = floors_of(self.compartments, building)
        self._floors = known[parts]
        shapely.prepare([area.polygon for one in self.compartments for area in one.areas])
        self._read_air(float(crowd.height.mean()))
        self._find_available()
        self._can_be_met = bool(np.isfinite(self._limit).any() or np.isfinite(self._until).any())
        values = self._floors.number.values
        self._margins = Margins(
            floor=np.where(np.isnan(values), -1.0, values).astype(np.int64),
            until=self._until,
            cell=np.empty(n, np.int64),
            when=np.empty(n),
            areas=self._floors.areas,
            least=self.least,
            least_at=self.least_at,
            of_compartments=self._of_compartments,
        )

    def _check_quantities(self) -> None:
        """Refuse criteria of quantities that no source provides."""
        given = () if self._air is None else self._air.quantities
        for one in self.compartments:
            for name, quantities in CRITERIA.items():
                if name in one.limits and not any(quantity in given for quantity in quantities):
                    raise ScenarioError(
                        f"{self._case.source}: compartment {one.name!r}: no source of [[conditions]] provides "
                        f"{' or '.join(quantities)} for the criterion {name}; add it to the data, or remove {name}"
                    )

    def _read_air(self, height: float) -> None:
        """Find when each limit is first exceeded in each cell (cells,) [s], and the doses (times, 2, cells) there."""
        case, dose, n = self._case, self._case.dose, len(self._floors.level)
        limits = {item for one in self.compartments for item in one.limits.items() if item[0] in CRITERIA}
        self._first = {item: np.full(n, np.inf) for item in limits if item[0] != "fed"}
        self.until = math.inf
        self._times, self._doses = np.zeros(1), np.zeros((1, 2, n), np.float32)
        if self._air is None or not limits:
            return
        self.until = min(self._settings.factor * case.simulation.duration, self._air.last)
        number = max(1, min(math.ceil(self.until / PERIOD), MOST_READINGS // max(n, 1)))
        self._times = np.minimum(max(PERIOD, self.until / number) * np.arange(number + 1), self.until)
        self._doses = np.zeros((number + 1 if dose is not None else 1, 2, n), np.float32)
        heads, total = self._air.heads_at(self._floors.level, self._floors.place, height), np.zeros((2, n))
        rates, before = np.zeros((2, n)), dict[str, FloatArray]()
        for k, time in enumerate(self._times.tolist()):
            values = self._air.at(self._air.quantities, time, self._floors.level, self._floors.place, heads)
            air = dict(zip(self._air.quantities, values, strict=True))
            measures = self._measures(air)
            for (name, limit), first in self._first.items():
                _note(first, self._edge(name, limit), measures[name], before.get(name), time, self._times[k - 1])
            before = measures
            if dose is not None:
                now = dose_rates(dose, air)
                total += 0.5 * (time - self._times[k - 1]) * (rates + now) if k else 0.0
                self._doses[k], rates = total, now

    def _measures(self, air: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the quantities that are compared with the criteria, which are too great where these are met."""
        scale = irritant_scale(self._case.dose)
        found = {"visibility": air.get("extinction"), "temperature": air.get("temperature")}
        found["layer"] = -air["layer"] if "layer" in air else None
        found["fic"] = irritant_concentration(air, scale) if any(name in air for name in IRRITANTS) else None
        return {name: values for name, values in found.items() if values is not None}

    def _edge(self, name: str, limit: float) -> float:
        """Return the value of a measure above which a criterion is met."""
        if name == "visibility":
            return self._case.smoke.contrast / limit if limit > 0.0 else math.inf
        return -limit if name == "layer" else limit

    def _find_available(self) -> None:
        """Find the available time of each compartment, its criterion, and when criteria are met in each cell."""
        n = len(self._floors.level)
        self._limit, self._until, self.available = np.full(n, np.inf), np.full(n, np.inf), list[tuple[float, str]]()
        for one, areas in zip(self.compartments, self._floors.areas, strict=True):
            own = np.flatnonzero(areas > 0.0)
            times, why = np.full(len(own), np.inf), np.full(len(own), "", "<U11")
            for name, limit in one.limits.items():
                if name == "available":
                    met = np.full(len(own), limit)
                elif name == "fed":
                    self._limit[own] = np.minimum(self._limit[own], limit)
                    met = self._when(own, np.full((2, len(own)), limit))
                else:
                    met = self._first[name, limit][own]
                why = np.where(met < times, name, why)
                times = np.minimum(times, met)
                if name != "fed":
                    self._until[own] = np.minimum(self._until[own], met)
            order = np.argsort(times, kind="stable")
            part = np.cumsum(areas[own][order])
            least = order[np.searchsorted(part, one.share * part[-1] * (1.0 - 1e-9))] if len(own) else 0
            self.available.append((float(times[least]), str(why[least])) if len(own) else (math.inf, ""))

    def _when(self, cells: IndexArray, target: FloatArray) -> FloatArray:
        """Return when the doses in cells (n,), of those who stay there from the start, reach targets (2, n) [s]."""
        when = np.full(len(cells), np.inf)
        ever = np.flatnonzero((self._doses[-1][:, cells] >= target).any(axis=0))
        if len(self._doses) == 1 or not len(ever):
            return when
        cells, target = cells[ever], target[:, ever]
        low, high = np.zeros(target.shape, np.intp), np.full(target.shape, len(self._doses))
        kind = np.arange(2)[:, None]
        while (low < high).any():
            middle = np.minimum((low + high) // 2, len(self._doses) - 1)
            reached = self._doses[middle, kind, cells] >= target
            low, high = np.where(reached | (low == high), low, middle + 1), np.where(reached, middle, high)
        last = np.clip(low, 1, max(len(self._doses) - 1, 1))
        before, after = self._doses[last - 1, kind, cells], self._doses[last, kind, cells]
        share = np.divide(target - before, after - before, out=np.zeros(target.shape), where=after > before)
        times = self._times[last - 1] + np.clip(share, 0.0, 1.0) * (self._times[last] - self._times[last - 1])
        when[ever] = np.where(low == len(self._doses), np.inf, np.where(low == 0, 0.0, times)).min(axis=0)
        return when

    def look(self, time: float, arrived: BoolArray, doses: FloatArray | None) -> None:
        """Look at the people at a time [s], with those who are at a safe place (n,) and the doses (2, n) of all."""
        crowd, presence = self._crowd, self._presence
        for own, one in zip(presence.in_areas, self.compartments, strict=True):
            own[:] = 0
            for area in one.areas:
                here = np.flatnonzero(crowd.level == area.level)
                own[here] |= shapely.intersects_xy(area.polygon, *crowd.position[here].T)
        presence.leaves[:] = self._leaves & ~arrived
        look_who_left(crowd, presence, time)
        if self._can_be_met:
            find_times(crowd, self._floors.number.index, self._margins)
            if doses is not None:
                self._count_doses(time, doses)
            note_margins(self._margins, time)

    def _count_doses(self, time: float, doses: FloatArray) -> None:
        """Let criteria be met earlier where the doses (2, n) of people at a time [s] will have reached a limit."""
        rows = np.flatnonzero(self._margins.cell >= 0)
        cells = self._margins.cell[rows]
        if np.isfinite(self._limit[cells]).any():
            when, rest = self._margins.when[rows], self._limit[cells] - doses[:, rows]
            k = int(np.clip(np.searchsorted(self._times, time), 1, len(self._times) - 1))
            share = (time - self._times[k - 1]) / (self._times[k] - self._times[k - 1])
            now = self._doses[k - 1][:, cells] * (1.0 - share) + self._doses[k][:, cells] * share
            when = np.minimum(when, np.where((rest > 0.0).all(axis=0), self._when(cells, now + rest), np.inf))
            for reached, dose in zip(self._reached, self._doses_to_reach, strict=True):
                reached[rows[(doses[:, rows].max(axis=0) >= dose) & np.isinf(reached[rows])]] = time
                when = np.where(self._limit[cells] == dose, np.minimum(when, reached[rows]), when)
            self._margins.when[rows] = when

    def results(self, crossings: tuple[IntArray, IntArray, FloatArray]) -> dict[str, Any]:
        """Return what the results of a run say: ``safety``, and ``margins``, columns of people.csv.

        People who cross a link in the tick in which they left a compartment left it at that time.
        """
        person, _, times = crossings
        left = np.fmin(self.left, np.where(np.isnan(self.left), np.nan, self._crowd.exit_time))
        tick = self._case.simulation.tick
        for own in left:
            near = (times <= own[person]) & (times > own[person] - tick)
            own[person[near]] = times[near]
        least = np.where(np.isinf(self.least), np.nan, self.least)
        return {
            "safety": {
                "factor": self._settings.factor,
                "percentile": self._settings.percentile,
                "compartments": list(self._rows(left)),
            },
            "margins": {"least_margin": least, "least_margin_at": self.least_at.copy()},
        }

    def _rows(self, left: FloatArray) -> Iterator[dict[str, Any]]:
        """Yield the row of each compartment."""
        for k, (one, own) in enumerate(zip(self.compartments, left, strict=True)):
            available, criterion = self.available[k]
            margin, person, time = self._of_compartments[k].tolist()
            is_met, met, required = math.isfinite(available), math.isfinite(margin), own[~np.isnan(own)]
            yield {
                "name": one.name,
                "people": len(required),
                "required": float(required.max()) if len(required) and np.isfinite(required).all() else None,
                "available": available if is_met else None,
                "criterion": criterion if is_met else "",
                "until": None if is_met or math.isinf(self.until) else self.until,
                "least_margin": margin if met else None,
                "least_margin_of": int(person) if met else None,
                "least_margin_at": time if met else None,
            }


def _note(
    first: FloatArray, edge: float, now: FloatArray, before: FloatArray | None, time: float, previous: float
) -> None:
    """Note when values first exceed an edge, of those that have not yet, linear since the previous time [s]."""
    new = np.flatnonzero(np.isinf(first) & (now > edge))
    if before is None:
        first[new] = time
    else:
        share = (edge - before[new]) / (now[new] - before[new])
        first[new] = previous + np.clip(share, 0.0, 1.0) * (time - previous)


class Presence(Struct):
    """Which compartments people belong to, are in, and have left."""

    on: ByteGrid  # (compartments, levels) 1: the compartment has this level
    on_stairs: ByteGrid  # (compartments, levels) 1: it is one of its stairs, to which all on them belong
    everybody: Bytes  # (compartments,) 1: all who come into it belong to it, not only those who start there
    leaves: Bytes  # (n,) 1: is to leave, and is not at a safe place
    in_areas: ByteGrid  # (compartments, n) 1: is in one of its areas
    seen: Bytes  # (n,) 1: has been inside
    belongs: ByteGrid  # (compartments, n)
    left: FloatGrid  # (compartments, n) time [s]; inf of those who are there, NaN of those who have never been


@kernel
def look_who_left(crowd: Crowd, presence: Presence, time: float) -> None:
    """Look who of the people has come into compartments and left them."""
    for p in range(len(crowd.level)):
        at = crowd.level[p]
        for k in range(len(presence.everybody)):
            is_present = False
            if at >= 0 and (presence.on[k, at] != 0 or presence.in_areas[k, p] != 0):
                if presence.everybody[k] != 0 or presence.seen[p] == 0:
                    presence.belongs[k, p] = 1
                belongs = presence.belongs[k, p] != 0 or presence.on_stairs[k, at] != 0
                is_present = presence.leaves[p] != 0 and belongs
            if is_present:
                presence.left[k, p] = math.inf
            elif presence.left[k, p] == math.inf:
                presence.left[k, p] = time
        if at >= 0:
            presence.seen[p] = 1


class Margins(Struct):
    """Where people are, when a criterion is met there, and the least margins so far, of people and compartments."""

    floor: Longs  # (cells of levels,) cell of the floors; -1: none
    until: Floats  # (cells,) time at which a criterion other than a dose is met [s]
    cell: Longs  # (n,) cell of the floors in which each person is; -1: in none
    when: Floats  # (n,) time at which a criterion is met there [s]
    areas: FloatGrid  # (compartments, cells) [m2]
    least: Floats  # (n,) [s]
    least_at: Floats  # (n,) [s]
    of_compartments: Triples  # (compartments, 3) least margin [s], person, time [s]


@kernel
def find_times(crowd: Crowd, index: CellIndex, margins: Margins) -> None:
    """Find the cell in which each person is, and when a criterion other than a dose is met there."""
    for p in range(len(crowd.level)):
        cell = cell_at(index, crowd.level[p], crowd.position[p, 0], crowd.position[p, 1])
        margins.cell[p] = margins.floor[cell] if cell >= 0 else -1
        if margins.cell[p] >= 0:
            margins.when[p] = margins.until[margins.cell[p]]


@kernel
def note_margins(margins: Margins, time: float) -> None:
    """Note the margins of people at a time [s] that are less than before."""
    for p in range(len(margins.cell)):
        cell = margins.cell[p]
        if cell < 0:
            continue
        margin = margins.when[p] - time
        if margin < margins.least[p]:
            margins.least[p], margins.least_at[p] = margin, time
        for k in range(len(margins.areas)):
            if margins.areas[k, cell] > 0.0 and margin < margins.of_compartments[k, 0]:
                margins.of_compartments[k, 0], margins.of_compartments[k, 1] = margin, p
                margins.of_compartments[k, 2] = time
