"""Results of a run: the egress curve, a row per person, a summary, and their files."""

import importlib.metadata
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.analysis.flows import exit_table
from evac.analysis.lines import LineFlow, flow_rows, line_flows, link_flows, totals
from evac.analysis.occupancy import Moves, moves_of
from evac.analysis.queues import Queue, find_queues
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.base.errors import ResultError
from evac.building.model.building import Building
from evac.contract.hooks import DEFAULT_MOVEMENT
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
from evac.folder.jsonfile import plain, write_json
from evac.folder.tables import write_csv
from evac.people.places import PeopleAt
from evac.people.population import Group
from evac.physics.state import Crowd
from evac.results.quality import chatter_warning, contact_warnings, crushing_warning, flow_warnings, remarks_of
from evac.results.watch import Observation

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from evac.case.case import Case
    from evac.results.answer import Answer
    from evac.results.record import Summary
    from evac.trajectory.trajectory import Trajectory


#: Packages whose version can affect results.
NUMERICAL_PACKAGES = ("evac", "numpy", "scipy", "numba", "shapely", "scikit-fmm")

EGRESS_COLUMNS = ("time", "number_out")
FLOWS_COLUMNS = ("time", "kind", "name", "direction", "count", "flow", "specific_flow")
CROSSINGS_COLUMNS = ("person", "portal", "time")
PEOPLE_COLUMNS = (
    *("person", "group", "start_x", "start_y", "start_level", "radius", "height", "mass", "tau"),
    *("speed", "speed_up", "speed_down", "arrival_time", "response_time", "route", "exit", "exit_time"),
    *("distance", "end_x", "end_y", "end_level"),
)

#: Columns of people.csv in addition, of a case with conditions of the air: those of `Exposure`.
EXPOSURE_COLUMNS = ("gas_dose", "heat_dose", "greatest_extinction", "greatest_irritants", "stopped_at")


#: Attributes of results that summary.json has under their own names.
AS_WRITTEN = (
    *("warnings", "quality_warnings", "notes", "entered_barred", "waiting_outside", "steps", "seed", "source"),
    *("metrics", "quickest", "conditions", "resumed", "keeps_distance", "plugins", "files", "plugin_files", "versions"),
)

#: The same of tables by name.
TABLES = ("exits", "portals", "levels", "stairs")


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that can affect results."""
    installed = {package: importlib.metadata.version(package) for package in NUMERICAL_PACKAGES}
    return MappingProxyType({"python": platform.python_version(), **installed})


@dataclass(frozen=True)
class Results:
    """The results of a run, as `evac.run` returns them or `Results.read` reads them from a result folder.

    Attributes
    ----------
    title : str
    settings : mapping
        Every key of the case with its value, as plain data; None stands for infinity.
    crowd : Crowd
        Arrays of all people at the end. In results that were read, velocities, contact forces, contact radii, speed
        factors and extra directions are NaN, because they are not written.
    groups : sequence of Group
        Groups with ``name`` and ``rows``.
    routes : sequence of Route
        Routes to which ``crowd.route`` refers.
    start_position : (n, 2) float64 [m]
    start_level : (n,) int32
    crossings : tuple of (m,) int32, (m,) int32, (m,) float64 [s]
        Person, portal and time of every crossing of a portal, in the order of the log; see
        `evac.analysis.occupancy.moves_of`.
    ended : str
        ``"everybody out"``, ``"everybody out or at a safe place"``, ``"everybody out who can move"``,
        ``"duration over"``, ``"no progress"``, ``"interrupted"`` or ``"failed"``.
    time : float
        Simulated time [s].
    steps : int
        Number of steps.
    seed : int
    exits, portals, levels, stairs : mapping of str to mapping
        The use of each exit, portal, level and stair, by name, as in summary.json (docs/summary.md).
    doors : sequence of mapping
        Name, level and width [m] of the doors between rooms that the file of the building names.
    places : sequence of PeopleAt
        The refuges and assembly areas, with the people who were there at the end.
    entered_barred : mapping of str to tuple of int
        The people who entered each area while it was barred, because they had no other way.
    notes : tuple of str
        Messages of behaviours about people, such as who was missing when a class was counted.
    stuck : sequence of int
        People inside at the end who had made no progress for 10 s, or for ``no_progress`` if that is less.
    warnings : sequence of str
        Warnings on building and people, from `Simulation.warnings`.
    quality_warnings : sequence of str
        Quality warnings (docs/results.md): numerical or physical problems of the results, one line each.
    keeps_distance : sequence of str
        Behaviours in use that make people keep distances.
    report : mapping
        Report of the contact model, with the keys described in docs/summary.md.
    phases : mapping of str to float
        Wall time of each phase [s].
    plan : sequence of (part, in or out, why)
    plugins : sequence of str
        Name and version of each plugin used in the run.
    versions : mapping of str to str
        Versions of Python and of the packages that can affect results.
    metrics : mapping
        Results of the ``evac_metrics`` hooks, by plugin.
    folder : Path or None
        Result folder of the run.
    files : sequence of str
        Files that the run has read, besides its case.
    plugin_files : sequence of str
        Files that plugins have written to the result folder.
    changes : sequence of Change
        Changes of the scene during the run, in order.
    waiting_outside : int
        Number of people who had not entered the building at the end because there was no free place for them.
    resumed : sequence of mapping
        Checkpoints from which the run was resumed, in order.
    quickest : mapping of str to number, optional
        Updates of the routes with the strategy "quickest", see docs/summary.md; None without such routes.
    conditions : mapping, optional
        Smoke, gases and heat, see docs/summary.md; None in a case without them.
    exposure : mapping of str to (n,) float64
        The `EXPOSURE_COLUMNS` by name, in a case with conditions.
    source : str
        File of the case.
    """

    title: str
    settings: Mapping[str, Any]
    case_or_reader: "Case | Callable[[], Case]" = field(repr=False, compare=False)
    building_or_none: Building | None = field(repr=False)
    crowd: Crowd
    groups: Sequence[Group]
    routes: Sequence[Route]
    start_position: FloatArray
    start_level: IntArray
    crossings: tuple[IntArray, IntArray, FloatArray]
    ended: str
    time: float
    steps: int
    seed: int
    exits: Mapping[str, Mapping[str, Any]]
    portals: Mapping[str, Mapping[str, Any]]
    levels: Mapping[str, Mapping[str, Any]]
    stairs: Mapping[str, Mapping[str, Any]]
    doors: Sequence[Mapping[str, Any]] = ()
    places: Sequence[PeopleAt] = ()
    entered_barred: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    stuck: Sequence[int] = ()
    warnings: Sequence[str] = ()
    quality_warnings: Sequence[str] = ()
    keeps_distance: Sequence[str] = ()
    report: Mapping[str, Any] = field(default_factory=dict)
    phases: Mapping[str, float] = field(default_factory=dict)
    plan: Sequence[tuple[str, str, str]] = ()
    plugins: Sequence[str] = ()
    versions: Mapping[str, str] = field(default_factory=versions)
    metrics: Mapping[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    files: Sequence[str] = ()
    plugin_files: Sequence[str] = ()
    changes: Sequence[Change] = ()
    waiting_outside: int = 0
    resumed: Sequence[Mapping[str, Any]] = ()
    quickest: Mapping[str, float] | None = None
    conditions: Mapping[str, Any] | None = None
    exposure: Mapping[str, FloatArray] = field(default_factory=dict)
    source: str = ""

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
        return self.case_or_reader() if callable(self.case_or_reader) else self.case_or_reader

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
    def trajectory(self) -> "Trajectory | None":
        """The recorded motion in the result folder; None if there is none."""
        from evac.trajectory.trajectory import read_trajectory

        path = None if self.folder is None else self.folder / TRAJECTORY_NAME
        return read_trajectory(path) if path is not None and path.is_file() else None

    def __repr__(self) -> str:
        last = "" if self.last_out is None else f", the last after {self.last_out:.1f} s"
        out = f"{self.evacuated} of {self.number_of_people} out"
        return f"<Results of {self.title or Path(self.source).name!r}: {self.ended}, {out}{last}>"

    def _repr_html_(self) -> str:
        """Return tables, the egress curve and the replay as HTML for notebooks."""
        from evac.pictures.notebook import results_html

        return results_html(self)

    def plot(self) -> "Figure":
        """Return the egress curve of all people and of each group as a figure of matplotlib."""
        from evac.pictures.pictures import egress_figure

        return egress_figure(self)

    @property
    def number_of_people(self) -> int:
        """Number of people."""
        return len(self.crowd.level)

    @cached_property
    def people(self) -> "DataFrame":
        """One row per person, with the columns of people.csv (docs/results.md); exit data are missing if not out."""
        from pandas import DataFrame

        columns = dict(zip(self.people_columns, self._people_columns(), strict=True))
        times = dict.fromkeys({"exit_time", "stopped_at"} & columns.keys(), float)
        return DataFrame(columns).astype(times).set_index("person")

    @property
    def people_columns(self) -> tuple[str, ...]:
        """Names of the columns of people.csv."""
        return PEOPLE_COLUMNS + (EXPOSURE_COLUMNS if self.exposure else ())

    @property
    def evacuated(self) -> int:
        """Number of people who are out."""
        return int(np.isfinite(self.crowd.exit_time).sum())

    @property
    def at_places(self) -> int:
        """Number of people at refuges or assembly areas, except those whom gases or heat have stopped."""
        return len({row for place in self.places for row in place.people} - {*self.stopped.tolist()})

    @property
    def is_complete(self) -> bool:
        """Whether everybody who is to leave is out or at a safe place, and nobody is to arrive or has been stopped."""
        return self.evacuated + self.at_places + self.staying == self.number_of_people and not len(self.stopped)

    @cached_property
    def stopped(self) -> IntArray:
        """Rows of the people whom gases or heat have stopped."""
        return np.flatnonzero(np.isfinite(self.exposure.get("stopped_at", np.zeros(0)))).astype(np.int32)

    @cached_property
    def _stays(self) -> NDArray[np.bool_]:
        """Whether each person is inside at the end and does not leave, (n,)."""
        stay = {group["name"] for group in self.settings["people"] if not group.get("leave", True)}
        rows = [group.rows for group in self.groups if group.name in stay]
        stays = np.zeros(self.number_of_people, np.bool_)
        stays[np.concatenate([np.zeros(0, np.int32), *rows])] = True
        return stays & (self.crowd.level >= 0)

    @property
    def staying(self) -> int:
        """Number of people inside at the end who do not leave, except those whom gases or heat have stopped."""
        return int(np.delete(self._stays, self.stopped).sum())

    @cached_property
    def leaving(self) -> IntArray:
        """Rows of people who are out or are to leave: without those who stay, are at a safe place or have not come."""
        leaves = ~self._stays & ~np.isnan(self.crowd.arrival_time)
        leaves[[row for place in self.places for row in place.people]] = False
        return np.flatnonzero(leaves).astype(np.int32)

    @property
    def not_arrived(self) -> int:
        """Number of people who have not entered the building, including the `waiting_outside`."""
        return int(np.isnan(self.crowd.arrival_time).sum())

    @property
    def last_out(self) -> float | None:
        """Time at which the last of the people who are out left [s]; None if nobody left."""
        return float(np.nanmax(self.crowd.exit_time)) if self.evacuated else None

    @property
    def left_by_other_exits(self) -> IntArray:
        """Rows of the people who left by an exit outside their route, for example because they were pushed."""
        leads_to = np.array([[route.leads_to(name) for name in self.exits] for route in self.routes])
        out = np.flatnonzero(self.crowd.exit_used >= 0)
        others: IntArray = out[~leads_to[self.crowd.route[out], self.crowd.exit_used[out]]].astype(np.int32)
        return others

    @property
    def not_started(self) -> int:
        """Number of people inside at the end whose response time was not over."""
        waits = (self.crowd.level >= 0) & (self.crowd.start_time > self.time) & ~self._stays
        waits[self.stopped] = False
        return int(waits.sum())

    @property
    def exit_status(self) -> int:
        """0 if everybody who is to leave is out or at a safe place, otherwise 3."""
        return 0 if self.is_complete else 3

    @property
    def remarks(self) -> tuple[str, ...]:
        """People left inside or stuck, and people who left by an exit outside their route, one line each."""
        return remarks_of(self)

    @cached_property
    def answer(self) -> "Answer":
        """The answer of the run in a few lines: who is out, when, by which exits, the longest queue, and warnings."""
        from evac.results.answer import answer_of

        return answer_of(self)

    @cached_property
    def moves(self) -> Moves:
        """All changes of level, in order of time."""
        crowd = self.crowd
        return moves_of(
            self.building, self.start_level, self.crossings, crowd.exit_time, crowd.arrival_time, crowd.exit_used
        )

    @cached_property
    def flow_totals(self) -> Sequence[Mapping[str, Any]]:
        """People and flow through each exit, portal, door and line, by direction, as in summary.json."""
        return totals(self.flows)

    @cached_property
    def flows(self) -> tuple[LineFlow, ...]:
        """Passages through exits and portals and, from the recorded motion, through doors and the lines of the case."""
        if self.trajectory is None:
            return tuple(link_flows(self.building, self.moves))
        return tuple(line_flows(self.trajectory, self.moves).values())

    @cached_property
    def queues(self) -> tuple[Queue, ...]:
        """The queues in the recorded motion, the longest first; empty without it."""
        return find_queues(self.trajectory) if self.trajectory is not None else ()

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
        levels, exits = [*self.levels, None], [*self.exits, None]  # None: index -1
        routes = [str(route) for route in self.routes]
        return [
            list(range(self.number_of_people)),
            self.group_names(),
            *self.start_position.T.tolist(),
            [levels[level] for level in self.start_level.tolist()],
            crowd.radius.tolist(),
            crowd.height.tolist(),
            crowd.mass.tolist(),
            crowd.tau.tolist(),
            *crowd.speed.T.tolist(),
            [time if time == time else None for time in crowd.arrival_time.tolist()],  # NaN: not come
            crowd.start_time.tolist(),
            [routes[route] for route in crowd.route.tolist()],
            [exits[used] for used in crowd.exit_used.tolist()],
            [time if time == time else None for time in crowd.exit_time.tolist()],  # NaN: inside
            crowd.distance.tolist(),
            *crowd.position.T.tolist(),
            [levels[level] for level in crowd.level.tolist()],
            *([value if value == value else None for value in self.exposure[name].tolist()] for name in self.exposure),
        ]

    def group_names(self) -> list[str]:
        """Return the name of each person's group, empty for people without group."""
        names = [""] * self.number_of_people
        for group in self.groups:
            for row in group.rows.tolist():
                names[row] = group.name
        return names

    def summary(self) -> dict[str, Any]:
        """Return the content of ``summary.json``: plain numbers, strings, lists and dictionaries."""
        levels = list(self.levels)
        stuck = zip(self.stuck, self.crowd.position[list(self.stuck)].tolist(), strict=True)
        summary = {
            "title": self.title,
            "people": self.number_of_people,
            "evacuated": self.evacuated,
            "last_out": self.last_out,
            "ended": self.ended,
            "exit_status": self.exit_status,
            "places": [asdict(place) for place in self.places],
            "stuck": [
                {"person": int(row), "level": levels[self.crowd.level[row]], "x": x, "y": y} for row, (x, y) in stuck
            ],
            "not_started": self.not_started,
            "not_arrived": self.not_arrived,
            "staying": self.staying,
            "stopped": len(self.stopped),
            "simulated_time": self.time,
            "doors": self.doors,
            "left_by_other_exits": len(self.left_by_other_exits),
            "flows": self.flow_totals,
            "routes": [asdict(route) for route in self.routes],
            "contact": self.report,
            "wall_time": self.phases,
            "plan": [{"part": part, "state": state, "why": why} for part, state, why in self.plan],
            "changes": [change.as_row() for change in self.changes],
            "case": self.settings,
        }
        summary |= {name: getattr(self, name) for name in (*TABLES, *AS_WRITTEN)}
        return {key: plain(value) for key, value in summary.items()}

    @cached_property
    def record(self) -> "Summary":
        """The content of ``summary.json`` with its types."""
        from evac.results.record import Summary

        return Summary.model_validate(self.summary())

    def write(self, folder: str | Path) -> None:
        """Write summary.json and the tables to `folder`, which is created if missing.

        Raises
        ------
        ResultError
            The folder or a file cannot be written.
        """
        folder = Path(folder)
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
        egress = zip(*(column.tolist() for column in self.egress()), strict=True)
        write_csv(folder / EGRESS_NAME, EGRESS_COLUMNS, egress)
        write_csv(folder / PEOPLE_NAME, self.people_columns, zip(*self._people_columns(), strict=True))
        write_csv(folder / FLOWS_NAME, FLOWS_COLUMNS, flow_rows(self.flows, self.time))
        if self.portals:
            names = list(self.portals)
            person, portal, time = (column.tolist() for column in self.crossings)
            rows = zip(person, (names[index] for index in portal), time, strict=True)
            write_csv(folder / CROSSINGS_NAME, CROSSINGS_COLUMNS, rows)

    def write_summary(self, folder: Path) -> None:
        """Write summary.json to `folder`.

        Raises
        ------
        ResultError
            The file cannot be written.
        """
        write_json(folder / SUMMARY_NAME, self.summary(), "the results")


def results_of(
    *,
    case: "Case",
    building: Building,
    crowd: Crowd,
    start_level: IntArray,
    crossings: tuple[IntArray, IntArray, FloatArray],
    report: Mapping[str, Any],
    chatter: Observation | None = None,
    crushing: Observation | None = None,
    overlaps: Observation | None = None,
    **others: Any,
) -> Results:
    """Return the results of a run, with the tables and quality warnings that follow from its data."""
    moves = moves_of(building, start_level, crossings, crowd.exit_time, crowd.arrival_time)
    exits = exit_table(building, crowd.exit_used, crowd.exit_time)
    names = [level.name for level in building.levels]
    models, behaviours = case.registry.contact_models, case.registry.behaviours
    rigid = [name for name, model in models.items() if model.rigid and name != case.contact.model]
    keepers = [name for name, behaviour in behaviours.items() if behaviour.keeps_distance]
    keepers.sort(key=lambda name: name != DEFAULT_MOVEMENT)
    advised = None if case.keeps_distance else keepers
    quality = [
        *(f"the building is incomplete: {one}" for one in building.findings if one.kind == "missing"),
        *contact_warnings(report, rigid, advised, overlaps),
        *([chatter_warning(chatter, names, rigid)] if chatter else []),
        *([crushing_warning(crushing, names, advised)] if crushing else []),
        *flow_warnings(exits, advised),
    ]
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
            portal.name: {"levels": [names[k] for k in portal.levels], "width": portal.width, "passages": passages[k]}
            for k, portal in enumerate(building.portals)
        },
        levels={level.name: asdict(moves.occupancy([level.index])) for level in building.levels},
        stairs={name: asdict(moves.occupancy(levels)) for name, levels in building.stairs.items()},
        doors=[{"name": door.name, "level": names[door.level], "width": door.width} for door in building.doors],
        quality_warnings=tuple(quality),
        keeps_distance=case.keeps_distance,
        **others,
    )
