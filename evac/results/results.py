"""Results of a run: the egress curve, a row per person, a summary, and their files."""

import importlib.metadata
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, Field, GetPydanticSchema, PlainSerializer
from pydantic_core import core_schema
from typing_extensions import TypedDict

from evac.analysis import lines
from evac.analysis.hydraulic import DesignFlow, design_flows, hydraulic_time
from evac.analysis.queues import Queue, QueueSearch, find_queues
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.base.errors import ResultError, usable_path
from evac.building.model.building import Building, ride_name
from evac.directions.routes import Route
from evac.folder.files import (
    CROSSINGS_NAME,
    EGRESS_NAME,
    FLOWS_NAME,
    PEOPLE_NAME,
    SUMMARY_NAME,
    TRAJECTORY_NAME,
    writing,
)
from evac.folder.textfiles import Amount, Count, adapter, plain, write_csv, write_json
from evac.people.places import PeopleAt
from evac.people.population import Group
from evac.physics.state import Crowd
from evac.results.ending import Observation
from evac.results.phases import PhaseUse, phases_of
from evac.results.quality import flow_warnings, noticed_of, queue_warnings, remarks_of
from evac.results.recordedcase import CaseTable
from evac.results.verdict import Verdict, verdict_of
from evac.trajectory.trajectory import Recorded, Trajectory, read_trajectory, trajectory_in_memory

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from evac.analysis.congestion import Exceedance
    from evac.analysis.maps import LevelMaps
    from evac.case.case import Case
    from evac.results.tables import Rows
    from evac.results.verdict import Answer

#: Packages whose version can affect results.
NUMERICAL_PACKAGES = ("evac", "numpy", "scipy", "numba", "shapely", "scikit-fmm")

EGRESS_COLUMNS = ("time", "number_out")

#: Exit, in people.csv, of people whom a program or a behaviour has removed.
REMOVED = "-"
FLOWS_COLUMNS = ("time", "kind", "name", "direction", "count", "flow", "specific_flow")
CROSSINGS_COLUMNS = ("person", "portal", "piece", "time")
PEOPLE_COLUMNS = (
    *("person", "group", "start_x", "start_y", "start_level", "start_piece", "radius", "height", "mass", "tau"),
    *("speed", "speed_up", "speed_down", "arrival_time", "response_time", "route", "exit", "exit_time"),
    *("distance", "end_x", "end_y", "end_level", "end_piece"),
)

#: Columns of people.csv in addition, of a case with conditions of the air: those of `Exposure`.
EXPOSURE_COLUMNS = ("gas_dose", "heat_dose", "greatest_extinction", "greatest_irritants", "stopped_at")

#: Columns of people.csv in addition, of a case with [safety]: those of `Safety`.
MARGIN_COLUMNS = ("least_margin", "least_margin_at")

T = TypeVar("T")

#: A field of results that summary.json does not have.
Unwritten = Annotated[T, GetPydanticSchema(lambda source, handler: core_schema.any_schema()), Field(exclude=True)]


class Derived(cached_property[T]):
    """A key of summary.json that follows from other data: its name, docstring and type are those of a method."""

    key = ""

    def __set_name__(self, owner: type[Any], name: str) -> None:
        super().__set_name__(owner, name)
        self.key = self.key or name

    @property
    def kind(self) -> Any:
        """Type of the value, with its bounds."""
        return get_type_hints(self.func, include_extras=True)["return"]


def derived(key: str) -> Callable[[Callable[[Any], T]], Derived[T]]:
    """Return the decorator of a `Derived` value whose key is not the name of the method."""

    def decorate(method: Callable[[Any], T]) -> Derived[T]:
        value = Derived(method)
        value.key = key
        return value

    return decorate


class PortalUse(TypedDict):
    """The levels that a portal connects, its width [m], and the number of passages in both directions."""

    levels: tuple[str, str]
    width: Amount
    passages: Count


class DoorRow(TypedDict):
    """A door between rooms; its width [m] is clear."""

    name: str
    level: str
    width: Amount


class LiftUse(TypedDict):
    """What a lift has carried; times [s]."""

    name: str
    storeys: Sequence[str]
    capacity: Count
    trips: Count
    people: Count
    mean_load: Amount | None
    mean_wait: Amount | None
    longest_wait: Amount | None
    last_ride: Amount | None
    by_hand: Amount | None


class StuckPlace(TypedDict):
    """Where a person is who no longer makes progress [m]."""

    person: Count
    level: str
    x: float
    y: float


class PlanRow(NamedTuple):
    """A part of the program that was needed (in) or left out (out), and why."""

    part: str
    state: str
    why: str


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that can affect results."""
    installed = {package: importlib.metadata.version(package) for package in NUMERICAL_PACKAGES}
    return {"python": platform.python_version(), **installed}


@dataclass(frozen=True, kw_only=True)
class Results:
    """The results of a run, as `evac.run` returns them or `Results.read` reads them from a result folder.

    Every key of summary.json (docs/summary.md) is declared here once: it is a field, or a `Derived` value that follows
    from others. Fields marked `Unwritten` are not in that file.
    """

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)

    title: str
    """Title of the case."""
    ended: str
    """How the run ended: everybody out, everybody out or at a safe place (a refuge or an assembly area), everybody out
    who can move, duration over, no progress, interrupted or failed."""
    time: Annotated[Amount, Field(alias="simulated_time")]
    """Simulated time [s]."""
    steps: Count
    """Number of steps."""
    seed: Count
    """Seed of all random numbers."""
    places: tuple[PeopleAt, ...] = ()
    """For each refuge and assembly area: name, kind, capacity (null: unlimited), the people who were there at the end,
    and when the `last` of them arrived [s] (null: nobody did); `evacuated` does not count them."""
    entered_barred: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """For each area, the people who entered it while it was barred, because they had no other way."""
    notes: tuple[str, ...] = ()
    """Lines on people: whose ways have closed, where they are and by which changes; and from behaviours, such as who
    was missing when a class was counted (docs/behaviours.md)."""
    waiting_outside: Count = 0
    """Number of the people of `not_arrived` who waited outside because there was no free place."""
    warnings: tuple[str, ...] = ()
    """The warnings that `evac check` shows: about the building, narrow places, people for whom no way is wide enough,
    unusual people, response times beyond the end of the run."""
    exits: Mapping[str, lines.ExitUse]
    """For each exit: people, last time [s], width [m], flow between the first and the last fifth of the people [1/s],
    and this flow per metre of width. Flows need at least 20 people, not all at the same time."""
    portals: Mapping[str, PortalUse]
    """For each portal between floors and stairs: these, width [m], number of passages in both directions."""
    levels: Mapping[str, lines.Occupancy]
    """For each level that is not a piece of a stair: number of people who used it, greatest number at one time, time at
    which the last person left it [s]."""
    stairs: Mapping[str, lines.StairUse]
    """The same of each stair, from storey to storey; with the index of each of its flights and landings (`pieces`)
    among all levels, and of each of the `portals` between these among all portals."""
    phase: Sequence[PhaseUse] = ()
    """For each phase of the case: its places (`of`), the `people` who started there, when its `alarm` sounded, when the
    first and the last of them started to walk (`first_start`, `last_start`), when all of them were out (`last_out`),
    and when each floor on which they started was `clear` of everybody [s] (null: it did not happen)."""
    doors: Sequence[DoorRow] = ()
    """Name, level and clear width [m] of each door between rooms that the building file names, as plans do."""
    lifts: Sequence[LiftUse] = ()
    """For each lift: the names of its `storeys` from bottom to top and its `capacity`; the `trips` with people, the
    `people` carried, the mean share of the capacity in these trips (`mean_load`), the `mean_wait` and
    `longest_wait` before its doors, when the doors have opened after the last of the trips (`last_ride`) [s]; and how
    long a calculation by hand takes for the people whom its bank has carried (`by_hand`) [s], see docs/lifts.md (null:
    it has carried nobody)."""
    routes: Annotated[Sequence[Route], Field(min_length=1)]
    """For each route: `exits` (none: any exit), `strategy`, `steepest` (steepest stair or ramp that it uses, rise over
    run; null: any), `refuge` (the area in which it ends instead of at an exit) and `lifts` (how it uses lifts)."""
    report: Annotated[Mapping[str, Any], Field(alias="contact")] = field(default_factory=dict)
    """The report of the contact model, see below."""
    phases: Annotated[Mapping[str, Amount], Field(alias="wall_time")] = field(default_factory=dict)
    """Wall time of each phase [s], after the case has been checked, until this file is written. kernels: loading or
    compiling; physics: the compiled loop; output: everything that is displayed or written; preparation: the rest."""
    plan: Annotated[Sequence[PlanRow], PlainSerializer(lambda rows: [PlanRow(*row)._asdict() for row in rows])] = ()
    """Parts of the program that the case needs, and parts that were left out, with the reason."""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Values added by plugins."""
    quickest: Mapping[str, Amount] | None = None
    """Null if nobody can take a route with the strategy "quickest". Otherwise: `updates`, the number of updates;
    `levels_solved`, the number of levels solved in them, for each route and class of bodies."""
    conditions: Mapping[str, Any] | None = None
    """Null in a case without `[[conditions]]`. Otherwise: `sources`; the `law` of speed; the `quantities` that are
    read; the `findings` of the sources; the `doses` over time (mean and greatest, every two seconds); the solves of
    `routes` and their CPU time since the start or the last resumption [s]; the `greatest_extinction` [1/m]; that from
    which on people with the mean speed are slower than when they wait (`slow_from`; null: none); and, with `[dose]`,
    the entry `dose`: `form`, `heat`, `threshold` and `susceptibility` of the dose, the required quantities
    that are `not_in_data`, the number of people with doses above 0.3 and 1, the greatest doses, and the number
    `stopped`."""
    safety: Mapping[str, Any] | None = None
    """Null in a case without `[safety]`. Otherwise: the `factor` and `percentile` of the case, and for each of the
    `compartments`: `name`; the number of `people` who belong to it; `required`, when the last of them left it [s]
    (null: not all did, or nobody belongs to it); `available`, when a criterion is met [s] (null: none is, `until` this
    time); the `criterion`; and the `least_margin` of a person in it [s], with whom (`least_margin_of`) and when
    (`least_margin_at`)."""
    changes: Annotated[
        Sequence[Annotated[Change, BeforeValidator(Change.from_row)]],
        PlainSerializer(lambda changes: [change.as_row() for change in changes]),
    ] = ()
    """Changes of the building during the run, in order (docs/recipes_events.md): `time` [s] from which each holds,
    `kind`, `what`, `values`. The value `let_through` of a closing exit, portal or stair lists the people whose bodies
    were on its line at that time, and whom alone it lets through; `warnings` lists them, too.
    The value of a closing stair is `"leave"` if people on it go on before it closes."""
    resumed: Sequence[Mapping[str, Any]] = ()
    """For each checkpoint from which the run was resumed: its `time` [s], and the permitted `differences` of versions,
    kernels and files."""
    files: Sequence[str] = ()
    """Files that the run has read besides its case: of the building, plugins, and data of conditions and behaviours."""
    plugin_files: Sequence[str] = ()
    """Files written to the folder by plugins."""
    source: str = ""
    """File of the case."""
    keeps_distance: Sequence[str] = ()
    """Names of the behaviours in use that make people keep distances."""
    plugins: Sequence[str] = ()
    """Name and version of each plugin used in the run."""
    versions: Mapping[str, str] = field(default_factory=lambda: dict(versions()))
    """Versions of Python and of the packages that can affect results."""
    settings: Annotated[Mapping[str, Any], Field(alias="case")]
    """Every key of the case with its value; null stands for infinity."""
    case_or_reader: Unwritten[Any] = field(repr=False, compare=False)  # a Case, or a function that returns it
    building_or_none: Unwritten[Building | None] = field(repr=False)
    #: arrays of all people at the end. In results that were read, velocities, contact forces, contact radii, speed
    #: factors and extra directions are NaN, because they are not written.
    crowd: Unwritten[Crowd]
    groups: Unwritten[Sequence[Group]]  #: groups with ``name`` and ``rows``
    start_position: Unwritten[FloatArray]  #: (n, 2) [m]
    start_level: Unwritten[IntArray]  #: (n,)
    #: person (m,), portal (m,) and time (m,) [s] of every crossing of a portal, in the order of the log; see
    #: `evac.analysis.lines.moves_of`
    crossings: Unwritten[tuple[IntArray, IntArray, FloatArray]]
    #: people inside at the end who had made no progress for 10 s, or for ``no_progress`` if that is less
    stuck: Unwritten[Sequence[int]] = ()
    #: the `EXPOSURE_COLUMNS` (n,) by name, in a case with conditions
    exposure: Unwritten[Mapping[str, FloatArray]] = field(default_factory=dict)
    #: the `MARGIN_COLUMNS` (n,) by name [s], in a case with [safety]; NaN for people on whose way no criterion is met
    margins: Unwritten[Mapping[str, FloatArray]] = field(default_factory=dict)
    folder: Unwritten[Path | None] = None  #: result folder of the run
    recorded: Unwritten[Recorded | None] = field(default=None, repr=False)  # the trajectory of a run without a folder
    noticed: Unwritten[Sequence[str]] = ()  # quality warnings but for those of flows and queues
    advised: Unwritten[Sequence[str] | None] = None  # behaviours that would keep distances, if none does

    @classmethod
    def read(cls, folder: str | Path, plugin_files: Iterable[str | Path] = ()) -> "Results":
        """Read the results of a run from its folder; the short form is `evac.read_results`, which explains it."""
        from evac.results.reading import read_results

        return read_results(folder, plugin_files)

    @property
    def case(self) -> "Case":
        """The case. For results that were read, it is loaded and checked on first use.

        Raises
        ------
        EvacError
            The case cannot be loaded any more, for example because its plugin is missing.
        """
        case: Case = self.case_or_reader() if callable(self.case_or_reader) else self.case_or_reader
        return case

    @property
    def building(self) -> Building:
        """The building.

        Raises
        ------
        ResultError
            The results were read, and no trajectory was recorded, which contains the building.
        """
        if self.building_or_none is None:
            raise ResultError(
                f"{self.folder}: contains no {TRAJECTORY_NAME}, and the building is part of that file; run the case "
                "with output.trajectory=true"
            )
        return self.building_or_none

    @cached_property
    def trajectory(self) -> Trajectory | None:
        """The recorded motion, in memory for a run without a folder; None if the case or `Simulation` wants none."""
        if self.recorded is not None:
            return trajectory_in_memory(self.recorded)

        path = None if self.folder is None else self.folder / TRAJECTORY_NAME
        return read_trajectory(path) if path is not None and path.is_file() else None

    def __repr__(self) -> str:
        last = "" if self.last_out is None else f", the last after {self.last_out:.1f} s"
        out = f"{self.evacuated} of {self.number_of_people} out"
        return f"<Results: {self.verdict['text']}; {self.title or Path(self.source).name!r}: {self.ended}, {out}{last}>"

    def _repr_html_(self) -> str:
        """Return tables, the egress curve and the replay as HTML for notebooks."""
        from evac.pictures.notebook import results_html

        return results_html(self)

    def plot(self) -> "Figure":
        """Return the egress curve of all people and of each group as a figure of matplotlib."""
        from evac.pictures.pictures import egress_figure

        return egress_figure(self)

    @Derived
    def verdict(self) -> Verdict:
        """Whether people leave in time (docs/safety.md): `status` ("green", "amber", "red", or "none" without a limit),
        `text`, and at the `compartment` whose margin with the safety factor is least: `required` and `available` time,
        `margin` and `margin_with_factor` [s].
        """
        return verdict_of(self.safety)

    @derived("people")
    def number_of_people(self) -> Count:
        """Number of people."""
        return len(self.crowd.level)

    @cached_property
    def people(self) -> "DataFrame":
        """One row per person, with the columns of people.csv (docs/results.md); exit data are missing if not out."""
        from pandas import DataFrame

        columns = dict(zip(self.people_columns, self._people_columns(), strict=True))
        times = dict.fromkeys({"exit_time", "stopped_at", *MARGIN_COLUMNS} & columns.keys(), float)
        return DataFrame(columns).astype(times).set_index("person")

    @property
    def people_columns(self) -> tuple[str, ...]:
        """Names of the columns of people.csv."""
        return (*PEOPLE_COLUMNS, *self.exposure, *self.margins)

    @Derived
    def evacuated(self) -> Count:
        """Number of people who are out."""
        return int(np.isfinite(self.crowd.exit_time).sum())

    @property
    def at_places(self) -> int:
        """Number of people at refuges or assembly areas, except those whom gases or heat have stopped."""
        return len({row for place in self.places for row in place.people} - {*self.stopped.tolist()})

    @property
    def is_complete(self) -> bool:
        """Whether everybody who is to leave is out or at a safe place, and nobody is to arrive or has been stopped."""
        over = self.evacuated + self.at_places + self.staying + self.spare
        return over == self.number_of_people and not len(self.stopped)

    @derived("stopped")
    def number_stopped(self) -> Count:
        """Number of people inside whom gases or heat have stopped; they are not counted as stuck or not started."""
        return len(self.stopped)

    @cached_property
    def stopped(self) -> IntArray:
        """Rows of the people whom gases or heat have stopped."""
        return np.flatnonzero(np.isfinite(self.exposure.get("stopped_at", np.zeros(0)))).astype(np.int32)

    @cached_property
    def _stays(self) -> NDArray[np.bool_]:
        """Whether each person is inside at the end and does not leave, (n,)."""
        stay = {group["name"] for group in self.settings["people"] if not group.get("leave", True)}
        return np.isin(self.group_names(), [*stay]) & (self.crowd.level >= 0)

    @Derived
    def staying(self) -> Count:
        """Number of people inside at the end who do not leave (`leave = false`), without those of `stopped`."""
        return int(np.delete(self._stays, self.stopped).sum())

    @cached_property
    def leaving(self) -> IntArray:
        """Rows of people who are out or are to leave: without those who stay, are at a safe place or have not come."""
        leaves = ~self._stays & ~np.isnan(self.crowd.arrival_time)
        leaves[[row for place in self.places for row in place.people]] = False
        return np.flatnonzero(leaves).astype(np.int32)

    @property
    def spare(self) -> int:
        """Number of people of a reserve (`arrive.reserve`) who were not added."""
        kept = {group["name"] for group in self.settings["people"] if (group.get("arrive") or {}).get("reserve")}
        return int((np.isin(self.group_names(), [*kept]) & np.isnan(self.crowd.arrival_time)).sum())

    @Derived
    def not_arrived(self) -> Count:
        """Number of people of groups that arrive (docs/recipes.md) who had not entered the building at the end."""
        return int(np.isnan(self.crowd.arrival_time).sum())

    @Derived
    def last_out(self) -> Amount | None:
        """Time at which the last of the people who are out left [s]; None (null) if nobody left."""
        return float(np.nanmax(self.crowd.exit_time)) if self.evacuated else None

    @derived("left_by_other_exits")
    def number_by_other_exits(self) -> Count:
        """Number of people who left by an exit outside their route, for example because they were pushed across it."""
        return len(self.left_by_other_exits)

    @property
    def left_by_other_exits(self) -> IntArray:
        """Rows of the people who left by an exit outside their route, for example because they were pushed."""
        leads_to = np.array([[route.leads_to(name) for name in self.exits] for route in self.routes])
        out = np.flatnonzero(self.crowd.exit_used >= 0)
        others: IntArray = out[~leads_to[self.crowd.route[out], self.crowd.exit_used[out]]].astype(np.int32)
        return others

    @Derived
    def not_started(self) -> Count:
        """Number of people inside at the end whose response time was not over."""
        waits = (self.crowd.level >= 0) & (self.crowd.start_time > self.time) & ~self._stays
        waits[self.stopped] = False
        return int(waits.sum())

    @Derived
    def exit_status(self) -> Count:
        """0 if everybody who is to leave is out or at a safe place, otherwise 3; see docs/status.md for commands."""
        return 0 if self.is_complete else 3

    @Derived
    def quality_warnings(self) -> tuple[str, ...]:
        """The quality warnings of the run (docs/results.md), one line each."""
        flows = flow_warnings(self.building, self.changes, self.flows, self.advised)
        return (*self.noticed, *flows, *queue_warnings(self))

    @property
    def remarks(self) -> tuple[str, ...]:
        """People left inside or stuck, and people who left by an exit outside their route, one line each."""
        return remarks_of(self)

    @cached_property
    def answer(self) -> "Answer":
        """The answer of the run in a few lines: who is out, when, by which exits, the longest queue, and warnings."""
        from evac.results.verdict import answer_of

        return answer_of(self)

    @cached_property
    def moves(self) -> lines.Moves:
        """All changes of level, in order of time."""
        crowd = self.crowd
        return lines.moves_of(
            self.building, self.start_level, self.crossings, crowd.exit_time, crowd.arrival_time, crowd.exit_used
        )

    @derived("flows")
    def flow_totals(self) -> list[lines.FlowUse]:
        """For each exit, portal, door and line of the case, and each direction in which somebody passed: people, first
        and last time [s], width [m], and the flow between the first and the last fifth of the people.
        """
        return lines.totals(self._flows_of_ends)

    @property
    def _flows_of_ends(self) -> list[lines.LineFlow]:
        """The flows but for those between the pieces of a stair."""
        within = {portal for stair in self.stairs.values() for portal in stair["portals"]}
        return [line for line in self.flows if line.name not in within]

    @cached_property
    def flows(self) -> tuple[lines.LineFlow, ...]:
        """Passages through exits and portals and, from the recorded motion, through doors and the lines of the case."""
        crossed = [] if self.trajectory is None else lines.line_flows(self.trajectory)
        return (*lines.link_flows(self.building, self.moves), *crossed)

    @cached_property
    def design_flows(self) -> list[DesignFlow]:
        """Exits, doors and stairs that people passed, with hydraulic values; empty without a recorded building."""
        if self.building_or_none is None:
            return []
        return design_flows(self.building, self.flows, self.crowd.exit_time)

    @property
    def above_design(self) -> list[tuple[float, DesignFlow]]:
        """The `design_flows` above the hydraulic ones by 1 % or more, with their ratios, from the greatest one."""
        ratios = [(flow.ratio, flow) for flow in self.design_flows if flow.ratio is not None]
        return sorted(((ratio, flow) for ratio, flow in ratios if ratio >= 1.01), key=lambda one: -one[0])

    @property
    def hydraulic(self) -> DesignFlow | None:
        """The place that decides the hydraulic evacuation time; None without one."""
        return hydraulic_time(self.design_flows)

    @cached_property
    def queues(self) -> tuple[Queue, ...]:
        """The queues in the recorded motion, the longest first; empty without it."""
        return find_queues(self.trajectory, self.flows, self._slow_from) if self.trajectory is not None else ()

    def maps(self, watched: "Exceedance") -> "Mapping[str, LevelMaps]":
        """Return maps of the recorded motion on the grids of `watched`; finds congestion and `queues` meanwhile."""
        search = QueueSearch(watched.trajectory, self.flows, self._slow_from)
        maps = watched.trajectory.maps(densities=watched.densities, also=search.add)
        vars(self)["queues"] = search.found()
        return maps

    @property
    def _slow_from(self) -> float | None:
        return (self.conditions or {}).get("slow_from")

    @cached_property
    def tables(self) -> "dict[str, Rows]":
        """The rows of the `evac.results.tables.TABLES`."""
        from evac.results.tables import tables_of

        return tables_of(self)

    @property
    def hold_up(self) -> Queue | None:
        """The longest queue; None if people waited little, or no motion was recorded."""
        return next((queue for queue in self.queues if not queue.is_little), None)

    def egress(self, rows: IntArray | None = None) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return the egress curve of all people, or of the people with indices `rows`.

        Returns
        -------
        time : (m + 1,) float64 [s]
            Zero, then the exit times in ascending order.
        number : (m + 1,) int64
            People out at that time: 0, 1, ..., m.
        """
        times = self.crowd.exit_time if rows is None else self.crowd.exit_time[rows]
        time = np.concatenate([[0.0], np.sort(times[np.isfinite(times)])])
        return time, np.arange(time.size)

    def _people_columns(self) -> list[list[Any]]:
        """Return the columns of the people table, in the order of `people_columns`."""
        crowd = self.crowd
        levels, exits = [*self.titles, (None, None)], [*self.exits, None]  # None: index -1
        routes = [str(route) for route in self.routes]
        removed = (np.isfinite(crowd.exit_time) & (crowd.exit_used < 0)).tolist()
        return [
            list(range(self.number_of_people)),
            self.group_names(),
            *self.start_position.T.tolist(),
            *([levels[level][part] for level in self.start_level.tolist()] for part in (0, 1)),
            crowd.radius.tolist(),
            crowd.height.tolist(),
            crowd.mass.tolist(),
            crowd.tau.tolist(),
            *crowd.speed.T.tolist(),
            [time if time == time else None for time in crowd.arrival_time.tolist()],  # NaN: not come
            crowd.start_time.tolist(),
            [routes[route] for route in crowd.route.tolist()],
            [REMOVED if gone else exits[used] for used, gone in zip(crowd.exit_used.tolist(), removed, strict=True)],
            [time if time == time else None for time in crowd.exit_time.tolist()],  # NaN: inside
            crowd.distance.tolist(),
            *crowd.position.T.tolist(),
            *([levels[level][part] for level in crowd.level.tolist()] for part in (0, 1)),
            *(
                [value if value == value else None for value in column.tolist()]
                for column in (*self.exposure.values(), *self.margins.values())
            ),
        ]

    @cached_property
    def titles(self) -> list[tuple[str, int | None]]:
        """Name of the floor or stair of each level, by its index, and the number of the piece of a stair."""
        return _by_index(self.levels, {name: stair["pieces"] for name, stair in self.stairs.items()})

    @cached_property
    def portal_titles(self) -> list[tuple[str, int | None]]:
        """Name of each portal by its index; of those within a stair the name of the stair, and their number in it."""
        return _by_index(self.portals, {name: stair["portals"] for name, stair in self.stairs.items()})

    @cached_property
    def crossed_titles(self) -> dict[int, tuple[str, int | None]]:
        """`portal_titles`, and those of the rides of lifts between neighbouring stops, by their numbers as links."""
        first = len(self.portal_titles) + len(self.exits) + len(self.doors)
        rides = [(ride_name(one["name"], *pair), None) for one in self.lifts for pair in pairwise(one["storeys"])]
        return dict(enumerate(self.portal_titles)) | dict(enumerate(rides, first))

    def titles_at(self, rows: Iterable[int]) -> list[str]:
        """Return the name of the floor or stair on which each of some people is at the end."""
        return [self.titles[level][0] for level in self.crowd.level[list(rows)].tolist()]

    def group_names(self) -> list[str]:
        """Return the name of each person's group, empty for people without group."""
        names = [""] * self.number_of_people
        for group in self.groups:
            for row in group.rows.tolist():
                names[row] = group.name
        return names

    @derived("stuck")
    def stuck_places(self) -> list[StuckPlace]:
        """Person, level, x, y of the people inside at the end who had made no progress towards an exit for 10 s, or for
        `no_progress` if that is shorter.
        """
        places = zip(
            self.stuck, self.titles_at(self.stuck), self.crowd.position[list(self.stuck)].tolist(), strict=True
        )
        return [StuckPlace(person=int(row), level=level, x=x, y=y) for row, level, (x, y) in places]

    @cached_property
    def case_table(self) -> CaseTable:
        """The parts of the case that reports and replays name, with their types."""
        return CaseTable.model_validate(self.settings)

    def summary(self) -> dict[str, Any]:
        """Return the content of ``summary.json``: plain numbers, strings, lists and dictionaries."""
        values = {value.key: getattr(self, name) for name, value in DERIVED.items()}
        fields = adapter(Results).dump_python(self, by_alias=True, warnings=False)
        return {key: plain(value) for key, value in ({"title": self.title} | values | fields).items()}

    def with_values(self, **values: Any) -> "Results":
        """Return the results with other wall times, files or folder; what has been computed from the rest is kept.

        The trajectory is read again from another folder.
        """
        results = replace(self, **values)
        gone = {"trajectory"} if "folder" in values else set()
        vars(results).update({name: value for name, value in vars(self).items() if name not in {*vars(results), *gone}})
        return results

    def write(self, folder: str | Path) -> None:
        """Write summary.json and the tables to `folder`, which is created if missing.

        Raises
        ------
        ResultError
            The folder or a file cannot be written.
        """
        folder = usable_path(folder, ResultError)
        with writing("the results", folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.write_tables(folder)
        self.write_summary(folder)

    def write_tables(self, folder: Path) -> None:
        """Write people.csv, egress.csv, flows.csv, and crossings.csv if the building has portals, to `folder`.

        Raises
        ------
        ResultError
            A file cannot be written.
        """
        flows = lines.flow_rows(self._flows_of_ends, self.time)
        egress = zip(*(column.tolist() for column in self.egress()), strict=True)
        write_csv(folder / EGRESS_NAME, EGRESS_COLUMNS, egress)
        write_csv(folder / PEOPLE_NAME, self.people_columns, zip(*self._people_columns(), strict=True))
        write_csv(folder / FLOWS_NAME, FLOWS_COLUMNS, flows)
        if titles := self.crossed_titles:
            columns = zip(*(column.tolist() for column in self.crossings), strict=True)
            rows = ((person, *titles[link], time) for person, link, time in columns)
            write_csv(folder / CROSSINGS_NAME, CROSSINGS_COLUMNS, rows)

    def write_summary(self, folder: Path) -> None:
        """Write summary.json to `folder`.

        Raises
        ------
        ResultError
            The file cannot be written.
        """
        write_json(folder / SUMMARY_NAME, self.summary(), "the results")


#: The values of summary.json that follow from others, by the names of their attributes.
DERIVED = {name: value for name, value in vars(Results).items() if isinstance(value, Derived)}


def _by_index(names: Iterable[str], stairs: Mapping[str, Mapping[str, int]]) -> list[tuple[str, int | None]]:
    """Return names in the order of their indices; stairs give those of their parts, and the others lie between them."""
    known = {index: (name, number) for name, own in stairs.items() for number, index in enumerate(own.values())}
    others = [(name, None) for name in names]
    rest = iter(others)
    return [known.get(index) or next(rest) for index in range(len(others) + len(known))]


def results_of(
    *,
    case: "Case",
    building: Building,
    crowd: Crowd,
    start_level: IntArray,
    crossings: tuple[IntArray, IntArray, FloatArray],
    report: Mapping[str, Any],
    seen: Mapping[str, Observation],
    **others: Any,
) -> Results:
    """Return the results of a run, with the tables and quality warnings that follow from its data."""
    advised, noticed = noticed_of(case, building, report, seen)
    exits = lines.exit_table(building, crowd.exit_used, crowd.exit_time)
    moves = lines.moves_of(building, start_level, crossings, crowd.exit_time, crowd.arrival_time)
    levels, stairs = lines.use_of_levels(building, moves)
    start, changes = (start_level, others["start_position"]), others.get("changes", ())
    phase = phases_of(case.phase, building, crowd, others["groups"], start, changes, {**levels, **stairs})
    names = [level.title for level in building.levels]
    passages = np.bincount(crossings[1], minlength=len(building.portals)).tolist()
    return Results(
        title=case.title,
        settings=plain(case.to_dict()),
        source=str(case.source),
        case_or_reader=case,
        building_or_none=building,
        crowd=crowd,
        start_level=start_level,
        crossings=crossings,
        report=plain(report),
        exits=exits,
        portals={
            portal.name: PortalUse(
                levels=(names[portal.levels[0]], names[portal.levels[1]]), width=portal.width, passages=passages[k]
            )
            for k, portal in enumerate(building.portals)
            if names[portal.levels[0]] != names[portal.levels[1]]
        },
        levels=levels,
        stairs=stairs,
        phase=phase,
        doors=[DoorRow(name=door.name, level=names[door.level], width=door.width) for door in building.doors],
        noticed=noticed,
        advised=advised,
        keeps_distance=case.keeps_distance,
        **others,
    )
