"""The air of a run: the sources of its conditions, read at places and times, and its smoke as a field of cells."""

import math
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.arrays import COPY, FloatArray, IndexArray, IntArray, as_floats, read_only
from evac.base.errors import ScenarioError, fault, naming, plugin_code
from evac.building.model.building import Building
from evac.building.model.cells import MOST_CELLS, LevelField
from evac.building.model.elevation import ground_of
from evac.conditions.law import SMOKE, SPEED
from evac.conditions.source import AT_ONCE, HEAD, QUANTITIES, ConditionSource, SourceScene
from evac.contract.registry import create

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.simulation.scene import Scene


NAME, UNIT = SMOKE, "1/m"  #: Name and unit of the field, which behaviours and trajectories know it by.
SPACING, PERIOD = 1.0, 2.0  #: Least side of its cells [m], and time between two updates [s].


class Air:
    """The conditions of the air in a building; where several sources apply, the last one does."""

    def __init__(self, case: "Case", building: Building, heads: dict[str, float], needed: tuple[str, ...]) -> None:
        self._where, self._settings = case.source, case.conditions
        # one for each table `[[conditions]]`
        self.sources: list[ConditionSource] = [
            create("source", case.registry.get("condition_source", table.source), table.parameters)
            for table in case.conditions
        ]
        self.scenes = [SourceScene(building, case.folder, table, heads, needed) for table in case.conditions]
        self._given: list[frozenset[str]] = []
        # quantities that at least one source provides somewhere on each level
        self.given: list[set[str]] = [set() for _ in building.levels]
        for index, (source, scene) in enumerate(zip(self.sources, self.scenes, strict=True)):
            what = f"source {source.name!r}: open"
            with naming(f"{case.source}: conditions.{index}"), plugin_code(what, source):
                given = frozenset(source.open(scene))
                if math.isnan(source.last):
                    raise fault(
                        what, "last is NaN", "give the time of its last values, or leave it out", source, "last"
                    )
                if unknown := sorted(given - QUANTITIES.keys()):
                    raise ScenarioError(
                        f"{what}: there are no quantities {', '.join(unknown)}; use those of docs/fire_data.md"
                    )
                for level in scene.levels():
                    self.given[level] |= given
            self._given.append(given)
        self.quantities = tuple(name for name in QUANTITIES if any(name in given for given in self._given))
        self._grounds = [ground_of(building.vertices, level) for level in building.levels]

    @property
    def last(self) -> float:
        """Time of the run after which a source has no values [s]."""
        ends = zip(self.sources, self._settings, strict=True)
        return min((source.last - own.start for source, own in ends if not own.hold), default=np.inf)

    def changes_after(self, time: float) -> bool:
        """Return whether values of a source change after a time of the run [s]."""
        ends = [source.last if source.changes_until is None else source.changes_until for source in self.sources]
        return any(time + own.start < end - AT_ONCE for own, end in zip(self._settings, ends, strict=True))

    def heads_at(self, level: IntArray, position: FloatArray, height: FloatArray | float) -> FloatArray:
        """Return the heights z (n,) of the heads of people with body heights (n,) on levels (n,) [m]."""
        ground = np.empty(len(level))
        for index in np.unique(level).tolist():
            rows = np.flatnonzero(level == index)
            ground[rows] = self._grounds[index](position[rows])
        return ground + HEAD * np.asarray(height)

    def at(
        self, quantities: Sequence[str], time: float, level: IntArray, position: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the values (q, n) of quantities at places of heights z (n,) [m]; clear air where no source applies.

        ScenarioError if the time lies behind the end of a source whose last values do not hold.
        """
        result = np.empty((len(quantities), len(level)))
        for row, name in enumerate(quantities):
            result[row] = QUANTITIES[name].clear
        places = read_only(level), read_only(position), read_only(height)
        for index, (source, own, given) in enumerate(zip(self.sources, self._settings, self._given, strict=True)):
            rows = [row for row, name in enumerate(quantities) if name in given]
            if not rows:
                continue
            at = time + own.start
            if at > source.last + AT_ONCE:
                if not own.hold:
                    raise ScenarioError(
                        f"{self._where}: conditions.{index}: the values end at {source.last - own.start:g} s of the "
                        "run, which lasts longer; compute them for longer, or set hold = true to keep the last values"
                    )
                at = source.last
            with plugin_code(f"t = {time:.3f} s: source {source.name!r}", source, COPY):
                values = as_floats(source.at([quantities[row] for row in rows], at, *places))
            values = _checked(values, [quantities[row] for row in rows], len(level), source)
            is_known = ~np.isnan(values)
            if is_known.all():
                result[rows] = values
            else:
                result[rows] = np.where(is_known, values, result[rows])
        return result


def _checked(values: FloatArray, names: Sequence[str], people: int, source: ConditionSource) -> FloatArray:
    """Return the values (q, n) of a source, which lie in the ranges of quantities or are NaN."""
    what = f"source {source.name!r}: at"
    if values.shape != (len(names), people):
        wrong = f"returns values of shape {values.shape}, not {(len(names), people)}"
        raise fault(what, wrong, "return a row for each quantity, with a value for each place", source, "at")
    ends = np.array([(QUANTITIES[name].least, QUANTITIES[name].most) for name in names]).T
    low, high = np.fmin.reduce(values, axis=1, initial=np.inf), np.fmax.reduce(values, axis=1, initial=-np.inf)
    for row in np.flatnonzero((low < ends[0]) | (high > ends[1])).tolist():
        own, wrong = QUANTITIES[names[row]], low[row] if low[row] < ends[0, row] else high[row]
        limits = f"return values from {own.least:g} to {own.most:g} {own.unit}, NaN where it does not apply"
        raise fault(what, f"gives {wrong:g} for {names[row]}", limits, source, "at")
    return values


class SmokeField:
    """What is recorded of the smoke, on square cells of all levels, at the heads of people of a height [m].

    These are the extinction coefficient, if it is among the quantities, and with `speed`, which returns what the values
    of the quantities leave of a mean desired speed (n,) [m/s], this speed.
    """

    def __init__(
        self,
        air: Air,
        scene: "Scene",
        height: float,
        quantities: Sequence[str],
        speed: Callable[[Mapping[str, FloatArray]], FloatArray] | None,
    ) -> None:
        levels = scene.building.levels
        bounds = np.array([level.polygon.bounds for level in levels])
        area = float(np.prod(bounds[:, 2:] - bounds[:, :2] + 4.0 * SPACING, axis=1).sum())
        spacing = max(SPACING, math.ceil(math.sqrt(2.0 * area / MOST_CELLS)))
        self._air, self._quantities = air, quantities
        self._fields: list[tuple[LevelField, Callable[[Mapping[str, FloatArray]], FloatArray]]] = []
        if NAME in quantities:
            self._fields.append((scene.add_field(NAME, UNIT, spacing), itemgetter(NAME)))
        if speed is not None:
            self._fields.append((scene.add_field(SPEED, "m/s", spacing), speed))
        clear = {name: np.array([QUANTITIES[name].clear]) for name in quantities}
        places, cells, level_of, first = [], [], [], 0
        for field, value in self._fields:
            field.values[:] = value(clear)
        for level, grid in zip(levels, self._fields[0][0].cells, strict=True):
            centres = np.column_stack([values.ravel() for values in grid.centres()])
            ground = shapely.buffer(level.polygon, 0.5 * spacing, join_style="mitre")
            own = np.flatnonzero(shapely.intersects_xy(ground, *centres.T))
            places.append(centres[own])
            cells.append(first + own)
            level_of.append(np.full(len(own), level.index, np.int32))
            first += len(centres)
        self._cells: IndexArray = np.concatenate(cells)
        self._level, self._place = np.concatenate(level_of), np.concatenate(places)
        self._heads: FloatArray = air.heads_at(self._level, self._place, height)

    def update(self, time: float) -> None:
        """Write the values at a time of the run [s]."""
        values = self._air.at(self._quantities, time, self._level, self._place, self._heads)
        air = dict(zip(self._quantities, values, strict=True))
        for field, value in self._fields:
            field.values[self._cells] = value(air)
