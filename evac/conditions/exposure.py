"""Exposure of people to smoke, gases and heat: the air at their heads, their doses, and their speeds in smoke."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial import KDTree

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.building.model.building import DOWN, FLAT, UP, Building
from evac.conditions.air import NAME, PERIOD, Air, SmokeField
from evac.conditions.dose import COUNTED, MINUTE, NEEDED, dose_rates, irritant_concentration, irritant_scale
from evac.conditions.law import SmokeLaw, share_in_smoke, slow_from
from evac.conditions.source import AT_ONCE, HEAD, IRRITANTS, QUANTITIES
from evac.contract.registry import create
from evac.directions.fields import Fields
from evac.directions.raster.grids import OWN
from evac.people.groups import reference_speeds
from evac.people.population import Group
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.directions.smoky import Smoky
    from evac.simulation.scene import Scene

TOLD = (0.3, 1.0)  #: Doses above which people are counted.
LEAST_RATE = 1e-3  #: Rate above which a dose grows [1/min]: that of hot air of 36 C.
SERIES = ("time", "mean_gas", "greatest_gas", "mean_heat", "greatest_heat")  #: Columns of the doses over time.


def quantities_needed(case: "Case", law: SmokeLaw) -> tuple[str, ...]:
    """Return the quantities without which a case cannot be run: for the speed in smoke, and for the dose."""
    dose, needed = case.dose, list[str]()
    if law.needs_extinction:
        needed.append("extinction")
    if dose is None:
        return tuple(needed)
    if unknown := [name for name in dose.without if name not in QUANTITIES]:
        hint = did_you_mean(unknown[0], list(QUANTITIES))
        raise ScenarioError(f"{case.source}: dose.without: there is no quantity {unknown[0]!r}; {hint}")
    needed += [*NEEDED[dose.form], *(["temperature"] if dose.heat != "none" else [])]
    return tuple(name for name in needed if name not in dose.without)


def law_of(case: "Case") -> SmokeLaw:
    """Return the law of the speed in smoke of a case."""
    name = case.smoke.law
    law: SmokeLaw = create("law", case.registry.get("smoke_law", name), case.smoke.tables.get(name, {}))
    return law


def heads_of(case: "Case") -> dict[str, float]:
    """Return the mean height of the heads of each group above the floor [m]."""
    return {people.name: HEAD * people.height.mean() for people in case.people}


class Exposure(Saved):
    """The doses of all people, and the share of their speed that smoke leaves them; its field is added to the scene.

    `share` (n,) is 0 for those who have been stopped. `doses` (2, n) are those of gases and of heat; `extinction` [1/m]
    and `irritants` (n,) the greatest so far. `stopped_at` (n,) [s] is NaN for those who have not been `stopped` (n,).
    """

    saved = (
        *("share", "doses", "extinction", "irritants", "stopped_at"),
        *("_rates", "_time", "_shown", "_series", "routes"),
    )
    growing = ("_series",)

    def __init__(self, case: "Case", scene: "Scene", crowd: Crowd, groups: Sequence[Group]) -> None:
        self._case, self._crowd, self._dose, self._law = case, crowd, case.dose, law_of(case)
        self._needed = quantities_needed(case, self._law)
        self._levels = [level.title for level in scene.building.levels]
        self.air = air = Air(case, scene.building, heads_of(case), self._needed)
        self._check_needed()
        wanted = {"extinction", *IRRITANTS}
        if self._dose is not None:
            wanted |= {*COUNTED[self._dose.form], "temperature", "radiation"} - {*self._dose.without}
        self.quantities = tuple(name for name in air.quantities if name in wanted)
        self._slows = case.smoke.irritants and any(name in self.quantities for name in IRRITANTS)
        self._uphill = np.array([level.climb for level in scene.building.levels])
        n = len(crowd.level)
        self.share, self.doses, self.stopped = np.ones(n), np.zeros((2, n)), np.zeros(n, np.bool_)
        self.extinction, self.irritants, self.stopped_at = np.zeros(n), np.zeros(n), np.full(n, np.nan)
        self._rates, self._time = np.full((2, n), np.nan), np.nan  # of the doses, when they were last found
        self._series = np.zeros((0, len(SERIES)))
        self._shown = -PERIOD  # time at which the field was updated
        self.routes = RoutesInSmoke(case, air, self._law, crowd, self.stopped) if case.smoke.routes else None
        self._mean_speed = float(crowd.speed[:, FLAT].mean())
        shown = [NAME] * (NAME in air.quantities) if not self._slows else [*self.quantities]
        speed = self._speed_left if self._slows else None
        self._field = SmokeField(air, scene, float(crowd.height.mean()), shown, speed) if shown else None
        self.threshold = self._thresholds(groups)

    def _thresholds(self, groups: Sequence[Group]) -> FloatArray:
        """Return the dose at which each person stops (n,), from a generator of its own."""
        dose, simulation = self._dose, self._case.simulation
        threshold = np.full(len(self.share), np.inf if dose is None else dose.threshold)
        if dose is not None and dose.susceptibility == "log-normal":
            seed = simulation.seed if simulation.population_seed is None else simulation.population_seed
            for group in groups:
                names = ("people", group.name, "susceptibility")
                drawn = [generator_for(seed, *names, str(k)).standard_normal() for k in range(len(group.rows))]
                threshold[group.rows] *= np.exp(dose.sigma * np.array(drawn))
        return threshold

    def _check_needed(self) -> None:
        """Refuse levels on which sources provide some quantities, but not all that are needed."""
        for level, given in zip(self._levels, self.air.given, strict=True):
            lacking = [name for name in self._needed if name not in given]
            if lacking and (given or not self.air.quantities):
                name = lacking[0]
                what = f"[smoke] law {self._law.name!r}" if name == "extinction" else "[dose]"
                off = 'law = "none"' if name == "extinction" else f'dose.without = ["{name}"]'
                raise ScenarioError(
                    f"{self._case.source}: conditions: no source provides {name} ({QUANTITIES[name].doc}) on level "
                    f"{level!r}, which {what} needs; add it to the data, or set {off} to declare that it has no effect"
                    + "".join(f"; {line}" for line in self._findings())
                )

    def _findings(self) -> list[str]:
        """Return what the sources say about their data."""
        return [line for source in self.air.sources for line in source.findings()]

    def begin(self, time: float, fields: Fields) -> None:
        """Find the conditions at the start, unless this run is resumed."""
        if np.isnan(self._time):
            self.act(time, fields)

    def act(self, time: float, fields: Fields) -> None:
        """Find the conditions at people's heads, and add the doses since they were last found."""
        crowd = self._crowd
        if time >= self._shown + PERIOD - AT_ONCE:
            self._shown = time
            if self._field is not None:
                self._field.update(time)
            doses = self.doses[:, ~np.isnan(crowd.arrival_time)]
            if self._dose is not None and doses.size:
                row = [time, *np.column_stack([doses.mean(axis=1), doses.max(axis=1)]).ravel()]
                self._series = np.vstack([self._series, row])
        out = crowd.level < 0
        gone = np.flatnonzero(out & ~np.isnan(self._rates[0]))
        if len(gone):
            self.doses[:, gone] += self._owed(time)[:, gone]
            self._rates[:, gone] = np.nan
        rows = np.flatnonzero(~out)
        level, position = crowd.level[rows], crowd.position[rows]
        heads = self.air.heads_at(level, position, crowd.height[rows])
        values = self.air.at(self.quantities, time, level, position, heads)
        air = dict(zip(self.quantities, values, strict=True))
        if self._dose is not None and air:
            self._add_doses(time, rows, air)
        self._time = time
        smoke = air.get("extinction", 0.0)
        self.extinction[rows] = np.maximum(self.extinction[rows], smoke)
        self.share[rows] = self._share_left(self._desired(rows, fields), air)
        crowd.velocity[np.isfinite(self.stopped_at) & ~self.stopped] = 0.0
        np.isfinite(self.stopped_at, out=self.stopped)
        self.share[self.stopped] = 0.0

    def _share_left(self, desired: FloatArray, air: Mapping[str, FloatArray]) -> FloatArray:
        """Return the share (n,) of desired speeds (n,) [m/s] that the air leaves."""
        smoke = air.get("extinction", np.zeros_like(desired))
        return share_in_smoke(self._law, desired, smoke, irritant_concentration(air) if self._slows else None)

    def _speed_left(self, air: Mapping[str, FloatArray]) -> FloatArray:
        """Return the speed (n,) that the air leaves of the mean desired speed [m/s]."""
        desired = np.full_like(next(iter(air.values())), self._mean_speed)
        return desired * self._share_left(desired, air)

    def can_grow(self, time: float) -> bool:
        """Return whether doses of people inside who have not been stopped can grow at a time of the run [s]."""
        breathing = (self._crowd.level >= 0) & ~self.stopped
        if self._dose is None or not breathing.any() or time + self._case.simulation.tick > self.air.last:
            return False
        return bool((breathing & self._grows()).any()) or self.air.changes_after(time)

    def _grows(self) -> BoolArray:
        """Return whether each person takes a dose where it is, (n,)."""
        return np.asarray((self._rates >= LEAST_RATE / MINUTE).any(axis=0))

    def doses_at(self, time: float) -> FloatArray | None:
        """Return the doses of gases and of heat at a time [s], (2, n); None in a case without `[dose]`."""
        return None if self._dose is None else self.doses + self._owed(time)

    def _owed(self, time: float) -> FloatArray:
        """Return the doses (2, n) since the air was last read, at constant rates; of people who are out, up to then."""
        if np.isnan(self._time):
            return np.zeros_like(self._rates)
        span = np.maximum(np.fmin(self._crowd.exit_time, time) - self._time, 0.0)
        return np.where(np.isnan(self._rates), 0.0, self._rates) * span

    def _desired(self, rows: IndexArray, fields: Fields) -> FloatArray:
        """Return the desired speeds of people in clear air: on the flat, up or down [m/s]."""
        crowd = self._crowd
        uphill = self._uphill[crowd.level[rows]]
        on_stairs = np.flatnonzero(uphill.any(axis=1))
        use = np.full(len(rows), FLAT)
        if len(on_stairs):
            there = rows[on_stairs]
            climb = (fields.directions_at(*crowd.ways(there)) * uphill[on_stairs]).sum(axis=1)
            use[on_stairs] = np.where(climb > 0.0, UP, np.where(climb < 0.0, DOWN, FLAT))
        desired: FloatArray = crowd.speed[rows, use]
        return desired

    def _add_doses(self, time: float, rows: IndexArray, air: Mapping[str, FloatArray]) -> None:
        """Add the doses since the last time, and stop those who reach their threshold."""
        assert self._dose is not None
        if any(name in air for name in IRRITANTS):
            concentration = irritant_concentration(air, irritant_scale(self._dose))
            self.irritants[rows] = np.maximum(self.irritants[rows], concentration)
        rates = dose_rates(self._dose, air)
        before = np.where(np.isnan(self._rates[:, rows]), rates, self._rates[:, rows])
        span = 0.0 if np.isnan(self._time) else time - self._time
        gained = 0.5 * span * (before + rates)
        left = self.threshold[rows] - self.doses[:, rows]
        self.doses[:, rows] += gained
        self._rates[:, rows] = rates
        reached = (gained >= left) & ((left > 0.0) | np.isnan(self.stopped_at[rows]))
        since = np.divide(np.maximum(left, 0.0), gained, out=np.zeros_like(gained), where=gained > 0.0)
        at = np.where(reached, time - span + span * np.minimum(since, 1.0), np.nan)
        self.stopped_at[rows] = np.fmin(self.stopped_at[rows], np.fmin(*at))

    def warnings(self) -> tuple[str, ...]:
        """Return what the sources do not cover, and when their values end before the end of the longest run."""
        lines = self._findings()
        if self.air.last < self._case.simulation.duration:
            lines.append(
                f"{self._case.source}: conditions end at {self.air.last:g} s, and the run may last "
                f"{self._case.simulation.duration:g} s: it fails there, unless everybody is out, or hold = true"
            )
        return tuple(lines)

    def results(self, time: float) -> dict[str, Any]:
        """Return what the results of a run say at a time: ``exposure``, columns of people.csv, and ``conditions``."""
        dose, inside = self._dose, self._crowd.level >= 0
        doses = dict(zip(("gas", "heat"), self.doses + self._owed(time), strict=True))
        report: dict[str, Any] = {
            "sources": [table.source for table in self._case.conditions],
            "law": self._law.name,
            "quantities": self.quantities,
            "findings": self._findings(),
            "greatest_extinction": float(self.extinction.max(initial=0.0)),
            "slow_from": slow_from(self._law, self._mean_speed),
            "routes": None if self.routes is None else self.routes.report(),
            "doses": dict(zip(SERIES, self._series.T.tolist(), strict=True)),
            "dose": None,
        }
        if dose is not None:
            counted = COUNTED[dose.form] + (("temperature", "radiation") if dose.heat != "none" else ())
            report["dose"] = {
                "form": dose.form,
                "heat": dose.heat,
                "threshold": dose.threshold,
                "susceptibility": dose.susceptibility,
                "not_in_data": [name for name in counted if name not in self.quantities],
                **{f"{kind}_above_{dose:g}": int((own >= dose).sum()) for kind, own in doses.items() for dose in TOLD},
                **{f"greatest_{kind}": float(own.max(initial=0.0)) for kind, own in doses.items()},
                "stopped": int((self.stopped & inside).sum()),
                "growing": int((self._grows() & inside & ~self.stopped).sum()),
            }
        exposure = {
            **{f"{kind}_dose": own for kind, own in doses.items()},
            "greatest_extinction": self.extinction.copy(),
            "greatest_irritants": self.irritants.copy(),
            "stopped_at": self.stopped_at.copy(),
        }
        return {"conditions": report, "exposure": exposure}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        np.isfinite(self.stopped_at, out=self.stopped)


TURN_BACK = 100.0  #: Factor of the time where people turn back, and over people who lie there, if there is another way.


class RoutesInSmoke(Saved):
    """Has routes solved again when smoke has changed by more than `smoke.noticed` on a level."""

    saved = ("_counts", "_version")

    def __init__(self, case: "Case", air: Air, law: SmokeLaw, crowd: Crowd, stopped: BoolArray) -> None:
        self._settings, self._air, self._law, self._crowd, self._stopped = case.smoke, air, law, crowd, stopped
        self._height = float(crowd.height.mean())
        flat, up, down = reference_speeds(case)
        self._flat, self._sloped = flat, 0.5 * (up + down)
        names = ("extinction", "temperature", "radiation", *(IRRITANTS if case.smoke.irritants else ()))
        self._quantities = tuple(name for name in air.quantities if name in names)
        self._ticks = max(1, round(case.smoke.period / case.simulation.tick))
        self._nodes: list[tuple[IndexArray, FloatArray, FloatArray, FloatArray]] = []  # of each level
        self._of: object = None  # the grids that the nodes are those of
        self._version = -1
        self._counts, self._seconds = np.zeros(2, np.int64), 0.0  # solves, and levels that were solved in them

    def is_due(self, tick: int, version: int) -> bool:
        """Return whether to look at the smoke at a tick: in each period, and when the scene has changed."""
        return tick % self._ticks == 0 or version != self._version

    def update(self, now: float, scene: "Scene") -> bool:
        """Solve the routes again where smoke has changed at a time of the run [s]; return whether any was solved."""
        self._version = scene.ways_version
        began = time.process_time()
        self._find_nodes(scene.building, scene.fields)
        smoky: Smoky | None = scene.smoky
        size = scene.fields.grids[0].grids.size
        before = np.ones(size) if smoky is None else smoky.share
        share = before.copy()
        for level, (nodes, *_) in enumerate(self._nodes):
            share[nodes] = self._share_on(level, now)
        if (share < 1.0).any():
            share = _widened(scene.fields, share)
        self._walk_round(share)
        differs = [np.abs(share[nodes] - before[nodes]).max(initial=0.0) for nodes, *_ in self._nodes]
        changed = set(np.flatnonzero(np.array(differs) > self._settings.noticed).tolist())
        if changed:
            solved = scene.in_smoke().solve(changed, share)
            self._counts += (1, solved)
        self._seconds += time.process_time() - began
        return bool(changed)

    def _find_nodes(self, building: Building, fields: Fields) -> None:
        """Find places and heights of heads at the nodes on the ground of all levels, and the speeds in clear air."""
        if self._of is fields.grids:
            return
        self._of, self._nodes = fields.grids, []
        for level, grid in zip(building.levels, fields.grids[0].grids.levels, strict=True):
            own = np.flatnonzero(grid.sheet == OWN)
            places = grid.window.places(np.stack(np.unravel_index(own, grid.window.shape), axis=1))
            heads = self._air.heads_at(np.full(len(own), level.index, np.int32), places, self._height)
            desired = np.full(len(own), self._flat if not level.climb.any() else self._sloped)
            self._nodes.append((grid.offset + own, places, heads, desired))

    def _share_on(self, level: int, now: float) -> FloatArray:
        """Return the share (n,) of the speed at the nodes of a level, less where people turn back."""
        nodes, places, heads, desired = self._nodes[level]
        at = np.full(len(nodes), level, np.int32)
        air = dict(zip(self._quantities, self._air.at(self._quantities, now, at, places, heads), strict=True))
        smoke = air.get("extinction", np.zeros(len(nodes)))
        irritants = irritant_concentration(air) if any(name in air for name in IRRITANTS) else None
        share, settings = share_in_smoke(self._law, desired, smoke, irritants), self._settings
        turns_back = smoke * settings.visibility > settings.contrast
        for name, limit in (("temperature", settings.temperature), ("radiation", settings.radiation)):
            if name in air:
                turns_back |= air[name] > limit
        return np.where(turns_back, share / TURN_BACK, share)

    def _walk_round(self, share: FloatArray) -> None:
        """Reduce the shares (nodes,) of the speed where others would touch people who have been stopped."""
        crowd = self._crowd
        for level in np.unique(crowd.level[self._stopped & (crowd.level >= 0)]).tolist():
            nodes, places, *_ = self._nodes[level]
            rows = np.flatnonzero(self._stopped & (crowd.level == level))
            away, nearest = KDTree(crowd.position[rows]).query(places)
            touching = away < crowd.radius[rows[nearest]] + crowd.radius.mean()
            share[nodes[touching]] /= TURN_BACK

    def report(self) -> dict[str, float]:
        """Return what the summary of a run says about the solves."""
        return {"solves": int(self._counts[0]), "levels_solved": int(self._counts[1]), "cpu_seconds": self._seconds}


def _widened(fields: Fields, share: FloatArray) -> FloatArray:
    """Return the least share (nodes,) of the speed within the clearance of each node, also across portals."""
    # Paths keep their clearance from posts by a slowness that is up to nine times as great beside them. Where much
    # smoke ends at a door or a portal, they would lead along the post, since what lies behind it costs next to nothing.
    grids = fields.grids[0].grids
    reach = 1 + 2 * (1 + math.ceil(fields.clearance / grids.lattice.spacing))
    widened = share.copy()
    for grid in grids.levels:
        sheet, source = grid.sheet.ravel(), grid.source.ravel()
        own, halo = np.flatnonzero(sheet == OWN), np.flatnonzero((sheet != OWN) & (source >= 0))
        there = np.ones(len(sheet))
        there[own], there[halo] = share[grid.offset + own], share[source[halo]]
        least = minimum_filter(there.reshape(grid.window.shape), reach, mode="constant", cval=1.0)
        widened[grid.offset + own] = least.ravel()[own]
    return widened
