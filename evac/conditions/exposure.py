"""What people are exposed to: the air at their heads, the dose that they take, and the speed that smoke leaves them."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError, plugin_code
from evac.base.parameters import did_you_mean
from evac.base.saved import part_of, taken
from evac.building.model.building import DOWN, FLAT, UP
from evac.conditions.air import Air
from evac.conditions.dose import (
    COMPROMISING,
    COUNTED,
    INCAPACITATING,
    NEEDED,
    gas_rate,
    heat_rate,
    irritant_concentration,
)
from evac.conditions.law import SmokeLaw, share_in_smoke
from evac.conditions.quantities import IRRITANTS, QUANTITIES
from evac.conditions.routes import RoutesInSmoke
from evac.conditions.smokefield import NAME, PERIOD, SmokeField
from evac.conditions.source import AT_ONCE, HEAD
from evac.directions.fields import Fields
from evac.people.population import Group
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.fire import DoseSettings
    from evac.simulation.scene import Scene

#: Visibility below which a storey is commonly regarded as untenable, and the least that is distinguished from 0 [m].
TENABLE, LEAST = 10.0, 1e-6

#: Columns of the doses over time.
SERIES = ("time", "mean_gas", "greatest_gas", "mean_heat", "greatest_heat")

#: Factor of the mass of people who have been stopped, whom the push of others does not move.
FIRMNESS = 1e6

#: Seconds of a minute: rates of doses are per minute.
MINUTE = 60.0


def quantities_needed(case: "Case", law: SmokeLaw) -> tuple[str, ...]:
    """Return the quantities without which a case cannot be run: for the speed in smoke, and for the dose.

    Raises
    ------
    ScenarioError
        A quantity that is declared off does not exist.
    """
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
    law: SmokeLaw = _made(case, "law", "smoke_law", case.smoke.law, case.smoke.tables.get(case.smoke.law, {}))
    return law


def heads_of(case: "Case") -> dict[str, float]:
    """Return the mean height of the heads of each group above the floor [m]."""
    return {people.name: HEAD * people.height.mean() for people in case.people}


def _made(case: "Case", word: str, kind: str, name: str, table: Mapping[str, Any]) -> Any:
    """Return a plugin with its parameters."""
    cls = case.registry.get(kind, name)
    with plugin_code(f"{word} {name!r}: cannot be made", cls):
        return cls(**table)


def exposure_of(case: "Case", scene: "Scene", crowd: Crowd, groups: Sequence[Group]) -> "Exposure":
    """Return the exposure of the people of a case, with its sources and its law of speed in smoke.

    The field of smoke is added to the scene.

    Raises
    ------
    EvacError
        A source cannot be read, or lacks a quantity, or a plugin fails.
    """
    law = law_of(case)
    sources = [_made(case, "source", "condition_source", one.source, one.parameters) for one in case.conditions]
    air = Air(case, scene.building, sources, heads_of(case), quantities_needed(case, law))
    return Exposure(case, air, law, scene, crowd, groups)


class Exposure:
    """The doses of all people, and the share of their speed that smoke leaves them.

    Parameters
    ----------
    case : Case
    air : Air
    law : SmokeLaw
    scene : Scene
    crowd : Crowd
    groups : sequence of Group

    Attributes
    ----------
    air : Air
    routes : RoutesInSmoke or None
        Has routes solved again, unless the case has ``smoke.routes = false``.
    share : (n,) float64
        Share of the desired speed that smoke leaves each person; 0 for those who have been stopped.
    gas, heat : (n,) float64
        Doses.
    extinction, irritants : (n,) float64
        Greatest extinction coefficient [1/m], and greatest fractional irritant concentration, so far.
    stopped_at : (n,) float64
        Time at which each person was stopped [s]; NaN for the others.
    stopped : (n,) bool
        Whether each person has been stopped.

    Raises
    ------
    ScenarioError
        A quantity is needed that no source provides, or none of those on a level.
    """

    def __init__(
        self, case: "Case", air: Air, law: SmokeLaw, scene: "Scene", crowd: Crowd, groups: Sequence[Group]
    ) -> None:
        self._case, self.air, self._law, self._crowd = case, air, law, crowd
        self._dose: DoseSettings | None = case.dose
        self._levels = [level.name for level in scene.building.levels]
        self._check_needed()
        wanted = {"extinction", *IRRITANTS}
        if self._dose is not None:
            wanted |= {*COUNTED[self._dose.form], "temperature", "radiation"} - {*self._dose.without}
        self.quantities = tuple(name for name in air.quantities if name in wanted)
        self._slows = bool(case.smoke.irritants) and any(name in self.quantities for name in IRRITANTS)
        n = len(crowd.level)
        self.stopped: BoolArray = np.zeros(n, np.bool_)
        self.routes = RoutesInSmoke(case, air, law, crowd, self.stopped) if case.smoke.routes else None
        limits = np.array([case.smoke.contrast / max(limit, LEAST) for limit in (TENABLE, case.smoke.visibility)])
        self._field = SmokeField(air, scene, float(crowd.height.mean()), limits) if NAME in air.quantities else None
        self._series = np.zeros((0, 5))  # time, mean and greatest dose of gases, mean and greatest dose of heat
        self._shown = -PERIOD  # time at which the field was updated
        self._uphill = np.array([level.uphill for level in scene.building.levels])
        self.share, self.gas, self.heat = np.ones(n), np.zeros(n), np.zeros(n)
        self.extinction, self.irritants, self.stopped_at = np.zeros(n), np.zeros(n), np.full(n, np.nan)
        self._rates, self._time = np.full((2, n), np.nan), np.nan  # of gases and heat, when they were last found
        self.threshold = np.full(n, np.inf if self._dose is None else self._dose.threshold)
        if self._dose is not None and self._dose.susceptibility == "log-normal":
            own = case.simulation.population_seed
            seed = case.simulation.seed if own is None else own
            for group in groups:
                names = ("people", group.name, "susceptibility")
                drawn = [generator_for(seed, *names, str(k)).standard_normal() for k in range(len(group.rows))]
                self.threshold[group.rows] *= np.exp(self._dose.sigma * np.array(drawn))

    def _check_needed(self) -> None:
        """Refuse levels on which sources provide some quantities, but not all that are needed."""
        for level, given in zip(self._levels, self.air.given, strict=True):
            lacking = [name for name in quantities_needed(self._case, self._law) if name not in given]
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
        """Find the conditions at people's heads, and add the doses since they were last found.

        Rates are linear in between, and the time at which a threshold is reached follows from that.

        Parameters
        ----------
        time : float
            Time of the run [s].
        fields : Fields
            The current directions: people on stairs go up or down.
        """
        crowd = self._crowd
        if time >= self._shown + PERIOD - AT_ONCE:
            self._shown = time
            if self._field is not None:
                self._field.update(time)
            here = ~np.isnan(crowd.arrival_time)
            if self._dose is not None and here.any():
                row = np.array(
                    [time, *(find(own[here]) for own in (self.gas, self.heat) for find in (np.mean, np.max))]
                )
                self._series = np.vstack([self._series, row])
        owed = self._owed(time)
        out = crowd.level < 0
        self.gas[out] += owed[0, out]
        self.heat[out] += owed[1, out]
        self._rates[:, out] = np.nan
        rows = np.flatnonzero(~out)
        level, position = crowd.level[rows], crowd.position[rows]
        heads = self.air.heads_at(level, position, crowd.height[rows])
        values = self.air.at(self.quantities, time, level, position, heads)
        air = dict(zip(self.quantities, values, strict=True))
        if self._dose is not None and air:
            self._add_doses(time, rows, air)
        self._time = time
        smoke = air.get("extinction", np.zeros(len(rows)))
        self.extinction[rows] = np.maximum(self.extinction[rows], smoke)
        irritants = irritant_concentration(air) if self._slows else None
        self.share[rows] = share_in_smoke(self._law, self._desired(rows, fields), smoke, irritants)
        crowd.velocity[np.isfinite(self.stopped_at) & ~self.stopped] = 0.0
        np.isfinite(self.stopped_at, out=self.stopped)
        self.share[self.stopped], crowd.firmness[self.stopped] = 0.0, FIRMNESS

    def dose(self, time: float) -> FloatArray | None:
        """Return the greater one of the doses of each person at a time [s], (n,); None in a case without `[dose]`."""
        return None if self._dose is None else np.maximum(*np.stack([self.gas, self.heat]) + self._owed(time))

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
            where = crowd.level[there], crowd.position[there], crowd.route[there], crowd.contact_radius[there]
            climb = (fields.directions_at(*where) * uphill[on_stairs]).sum(axis=1)
            use[on_stairs] = np.where(climb > 0.0, UP, np.where(climb < 0.0, DOWN, FLAT))
        desired: FloatArray = crowd.speed[rows, use]
        return desired

    def _add_doses(self, time: float, rows: IndexArray, air: Mapping[str, FloatArray]) -> None:
        """Add the doses since the last time, and stop those who reach their threshold."""
        dose = self._dose
        assert dose is not None
        scale = COMPROMISING if dose.form == "iso" else INCAPACITATING
        if any(name in air for name in IRRITANTS):
            self.irritants[rows] = np.maximum(self.irritants[rows], irritant_concentration(air, scale))
        heat = heat_rate(dose.heat, air) if dose.heat != "none" and "temperature" in air else np.zeros(len(rows))
        rates = np.stack([gas_rate(dose.form, dose.activity, air), heat]) / MINUTE
        before = self._rates[:, rows]
        span = 0.0 if np.isnan(self._time) else time - self._time
        gained = 0.5 * span * (np.where(np.isnan(before), rates, before) + rates)
        self._rates[:, rows] = rates
        for taken_so_far, gain in zip((self.gas, self.heat), gained, strict=True):
            left = self.threshold[rows] - taken_so_far[rows]
            taken_so_far[rows] += gain
            reached = (gain >= left) & (left > 0.0)
            reached |= (left <= 0.0) & np.isnan(self.stopped_at[rows])
            since = np.divide(np.maximum(left, 0.0), gain, out=np.zeros_like(gain), where=gain > 0.0)
            at = time - span + span * np.minimum(since, 1.0)
            self.stopped_at[rows[reached]] = np.fmin(self.stopped_at[rows[reached]], at[reached])

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
        gas, heat = np.stack([self.gas, self.heat]) + self._owed(time)
        report: dict[str, Any] = {
            "sources": [one.source for one in self._case.conditions],
            "law": self._law.name,
            "quantities": self.quantities,
            "findings": self._findings(),
            "greatest_extinction": float(self.extinction.max(initial=0.0)),
            "routes": None if self.routes is None else self.routes.report(),
            "levels": self._times_of_levels(),
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
                "gas_above_0.3": int((gas >= 0.3).sum()),
                "gas_above_1": int((gas >= 1.0).sum()),
                "heat_above_0.3": int((heat >= 0.3).sum()),
                "heat_above_1": int((heat >= 1.0).sum()),
                "greatest_gas": float(gas.max(initial=0.0)),
                "greatest_heat": float(heat.max(initial=0.0)),
                "stopped": int((self.stopped & inside).sum()),
            }
        exposure = {
            "gas_dose": gas,
            "heat_dose": heat,
            "greatest_extinction": self.extinction.copy(),
            "greatest_irritants": self.irritants.copy(),
            "stopped_at": self.stopped_at.copy(),
        }
        return {"conditions": report, "exposure": exposure}

    def _times_of_levels(self) -> dict[str, dict[str, float | None]]:
        """Return for each level when the visibility fell below `TENABLE`, and below that at which people turn back."""
        if self._field is None:
            return {}
        found = {}
        for name, times in zip(self._levels, self._field.first.T.tolist(), strict=True):
            known = [None if time != time else time for time in times]
            found[name] = dict(zip(("untenable", "turns_back"), known, strict=True))
        return found

    def state(self, scene: "Scene") -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that are needed to continue with the same bits."""
        names = "share", "gas", "heat", "extinction", "irritants", "stopped_at"
        state: dict[str, NDArray[Any]] = {name: getattr(self, name).copy() for name in names}
        routes = {} if self.routes is None else self.routes.state(scene)
        state |= {f"routes.{name}": values for name, values in routes.items()}
        return (
            state
            | {"rates": self._rates.copy(), "time": np.array(self._time), "shown": np.array(self._shown)}
            | {
                "series": self._series,
                "first": np.zeros((0, 0)) if self._field is None else self._field.first.copy(),
            }
        )

    def restore(self, state: Mapping[str, NDArray[Any]], scene: "Scene") -> None:
        """Restore the arrays that `state` returned.

        Raises
        ------
        SavedError
            An array is not what `state` returns.
        """
        shape = self.share.shape
        self.share[:] = taken(state, "share", np.float64, shape, 0.0, 1.0)
        for name in ("gas", "heat", "extinction", "irritants", "stopped_at"):
            values = getattr(self, name)
            values[:] = taken(state, name, np.float64, shape, 0.0, np.inf, nan=name == "stopped_at")
        np.isfinite(self.stopped_at, out=self.stopped)
        self._rates[:] = taken(state, "rates", np.float64, self._rates.shape, 0.0, np.inf, nan=True)
        self._shown = float(taken(state, "shown", np.float64, (), -PERIOD, np.inf))
        self._series = taken(state, "series", np.float64, (None, 5), 0.0, np.inf)
        if self._field is not None:
            first = self._field.first
            first[:] = taken(state, "first", np.float64, first.shape, 0.0, np.inf, nan=True)
        if self.routes is not None and "routes.counts" in state:  # not if a changed case has added them
            with part_of(state, "routes.") as own:
                self.routes.restore(own, scene)
        self._time = float(taken(state, "time", np.float64, (), 0.0, np.inf, nan=True))
