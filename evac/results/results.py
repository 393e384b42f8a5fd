"""Results of a run: the egress curve, a row per person, a summary, and their files."""

import csv
import importlib.metadata
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.analysis.flows import exit_table
from evac.analysis.occupancy import Moves, level_table, moves_of, stair_table
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.building.model.building import Building
from evac.directions.routes import Route
from evac.folder.cells import cell_of
from evac.folder.files import EGRESS_NAME, PEOPLE_NAME, PLUGIN_FILES, SUMMARY_NAME, replacing, writing
from evac.physics.state import Crowd
from evac.results.quality import chatter_warning, contact_warnings, crushing_warning, flow_warnings
from evac.results.remarks import remarks_of
from evac.results.watch import Finding

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from evac.case.case import Case
    from evac.people.population import Group


#: Packages whose version can affect results.
NUMERICAL_PACKAGES = ("evac", "numpy", "scipy", "numba", "shapely", "scikit-fmm")

EGRESS_COLUMNS = ("time", "number_out")
PEOPLE_COLUMNS = (
    "person",
    "group",
    "start_x",
    "start_y",
    "start_level",
    "radius",
    "mass",
    "tau",
    "speed",
    "speed_up",
    "speed_down",
    "response_time",
    "route",
    "exit",
    "exit_time",
    "distance",
)


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that can affect results."""
    found = {package: importlib.metadata.version(package) for package in NUMERICAL_PACKAGES}
    return MappingProxyType({"python": platform.python_version(), **found})


@dataclass(frozen=True)
class Results:
    """The results of a run.

    Attributes
    ----------
    case : Case
    building : Building
    crowd : Crowd
        Arrays of all people at the end.
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
        ``"everybody out"``, ``"duration over"``, ``"no progress"``, ``"interrupted"`` or ``"failed"``.
    time : float
        Simulated time [s].
    steps : int
        Number of steps.
    seed : int
    stuck : sequence of int
        People inside at the end who had made no progress for 10 s, or for ``no_progress`` if that is less.
    warnings : sequence of str
        Warnings on building and people, from `Simulation.warnings`.
    report : mapping
        Report of the contact model, with the keys described in docs/results.md.
    chatter, crushing : Finding or None
        Findings during the run, see `evac.results.watch.Watch`.
    phases : mapping of str to float
        Wall time of each phase [s].
    plan : sequence of (part, in or out, why)
    plugins : sequence of str
        Name and version of each plugin used in the run.
    metrics : mapping
        Results of the ``evac_metrics`` hooks, by plugin.
    folder : Path or None
        Result folder of the run.
    plugin_files : sequence of str
        Files that plugins have written to the result folder.
    changes : sequence of Change
        Changes of the scene during the run, in order.
    resumed : sequence of mapping
        Checkpoints from which the run was resumed, in order.
    """

    case: "Case"
    building: Building
    crowd: Crowd
    groups: "Sequence[Group]"
    routes: Sequence[Route]
    start_position: FloatArray
    start_level: IntArray
    crossings: tuple[IntArray, IntArray, FloatArray]
    ended: str
    time: float
    steps: int
    seed: int
    stuck: Sequence[int] = ()
    warnings: Sequence[str] = ()
    report: Mapping[str, Any] = field(default_factory=dict)
    chatter: Finding | None = None
    crushing: Finding | None = None
    phases: Mapping[str, float] = field(default_factory=dict)
    plan: Sequence[tuple[str, str, str]] = ()
    plugins: Sequence[str] = ()
    metrics: Mapping[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    plugin_files: Sequence[str] = ()
    changes: Sequence[Change] = ()
    resumed: Sequence[Mapping[str, Any]] = ()

    def __repr__(self) -> str:
        last = "" if self.last_out is None else f", the last after {self.last_out:.1f} s"
        out = f"{self.evacuated} of {self.number_of_people} out"
        return f"<Results of {self.case.title or self.case.source.name!r}: {self.ended}, {out}{last}>"

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

        columns = dict(zip(PEOPLE_COLUMNS, self._people_columns(), strict=True))
        return DataFrame(columns).astype({"exit_time": float}).set_index("person")

    @property
    def evacuated(self) -> int:
        """Number of people who are out."""
        return int(np.isfinite(self.crowd.exit_time).sum())

    @property
    def last_out(self) -> float | None:
        """Time at which the last of the people who are out left [s]; None if nobody left."""
        return float(np.nanmax(self.crowd.exit_time)) if self.evacuated else None

    @property
    def left_by_other_exits(self) -> IntArray:
        """Rows of the people who left by an exit that does not belong to their route, for example when pushed."""
        exits = [exit_.name for exit_ in self.building.exits]
        leads_to = np.array([[route.leads_to(name) for name in exits] for route in self.routes])
        out = np.flatnonzero(self.crowd.exit_used >= 0)
        others: IntArray = out[~leads_to[self.crowd.route[out], self.crowd.exit_used[out]]].astype(np.int32)
        return others

    @property
    def not_started(self) -> int:
        """Number of people inside at the end whose response time was not over."""
        return int(((self.crowd.level >= 0) & (self.crowd.start_time > self.time)).sum())

    @property
    def exit_status(self) -> int:
        """0 if everybody is out, 3 if people are left."""
        return 0 if self.evacuated == self.number_of_people else 3

    @property
    def remarks(self) -> tuple[str, ...]:
        """People left inside or stuck, and people who left by an exit that is not on their route, one line each."""
        return remarks_of(self)

    @property
    def quality_warnings(self) -> tuple[str, ...]:
        """Quality warnings (docs/results.md): numerical or physical problems of the results, one line each."""
        levels = [level.name for level in self.building.levels]
        models, behaviours = self.case.registry.contact_models, self.case.registry.behaviours
        rigid = [name for name, model in models.items() if model.rigid and name != self.case.contact.model]
        keepers = [name for name, behaviour in behaviours.items() if behaviour.keeps_distance]
        advised = None if self.case.keeps_distance else keepers
        lines = [*contact_warnings(self.report, rigid)]
        if self.chatter:
            lines.append(chatter_warning(self.chatter, levels, rigid))
        if self.crushing:
            lines.append(crushing_warning(self.crushing, levels, advised))
        return (*lines, *flow_warnings(self.exits, advised))

    @cached_property
    def exits(self) -> Mapping[str, Mapping[str, Any]]:
        """The use of each exit, by name: see `evac.analysis.flows.exit_table`."""
        return exit_table(self.building, self.crowd.exit_used, self.crowd.exit_time)

    @cached_property
    def moves(self) -> Moves:
        """All changes of level, in order of time."""
        return moves_of(self.building, self.start_level, self.crossings, self.crowd.exit_time)

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
        """Return the columns of the people table, in the order of `PEOPLE_COLUMNS`."""
        crowd = self.crowd
        levels = [level.name for level in self.building.levels]
        routes = [str(route) for route in self.routes]
        exits = [exit_.name for exit_ in self.building.exits]
        out = np.isfinite(crowd.exit_time).tolist()
        return [
            list(range(self.number_of_people)),
            self.group_names(),
            *self.start_position.T.tolist(),
            [levels[level] for level in self.start_level.tolist()],
            crowd.radius.tolist(),
            crowd.mass.tolist(),
            crowd.tau.tolist(),
            *crowd.speed.T.tolist(),
            crowd.start_time.tolist(),
            [routes[route] for route in crowd.route.tolist()],
            [exits[used] if is_out else None for used, is_out in zip(crowd.exit_used.tolist(), out, strict=True)],
            [time if is_out else None for time, is_out in zip(crowd.exit_time.tolist(), out, strict=True)],
            crowd.distance.tolist(),
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
        summary = {
            "title": self.case.title,
            "people": self.number_of_people,
            "evacuated": self.evacuated,
            "last_out": self.last_out,
            "ended": self.ended,
            "exit_status": self.exit_status,
            "stuck": self._stuck_places(),
            "not_started": self.not_started,
            "warnings": self.warnings,
            "quality_warnings": self.quality_warnings,
            "simulated_time": self.time,
            "steps": self.steps,
            "exits": self.exits,
            "doors": [
                {"name": door.name, "level": self.building.levels[door.level].name, "width": door.width}
                for door in self.building.doors
            ],
            "left_by_other_exits": len(self.left_by_other_exits),
            "levels": {name: asdict(use) for name, use in level_table(self.building, self.moves).items()},
            "stairs": {name: asdict(use) for name, use in stair_table(self.building, self.moves).items()},
            "contact": self.report,
            "wall_time": self.phases,
            "plan": [{"part": part, "state": state, "why": why} for part, state, why in self.plan],
            "metrics": self.metrics,
            "changes": [change.as_row() for change in self.changes],
            "resumed": self.resumed,
            PLUGIN_FILES: self.plugin_files,
            "seed": self.seed,
            "case": self.case.to_dict(),
            "keeps_distance": self.case.keeps_distance,
            "plugins": self.plugins,
            "versions": versions(),
        }
        return {key: plain(value) for key, value in summary.items()}

    def write(self, folder: Path) -> None:
        """Write summary.json, egress.csv and people.csv to `folder`, which is created if missing.

        Raises
        ------
        ResultError
            The folder or a file cannot be written.
        """
        with writing("the results", folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.write_tables(folder)
        self.write_summary(folder)

    def write_tables(self, folder: Path) -> None:
        """Write egress.csv and people.csv to `folder`.

        Raises
        ------
        ResultError
            A file cannot be written.
        """
        egress = zip(*(column.tolist() for column in self.egress()), strict=True)
        write_csv(folder / EGRESS_NAME, EGRESS_COLUMNS, egress)
        write_csv(folder / PEOPLE_NAME, PEOPLE_COLUMNS, zip(*self._people_columns(), strict=True))

    def write_summary(self, folder: Path) -> None:
        """Write summary.json to `folder`.

        Raises
        ------
        ResultError
            The file cannot be written.
        """
        text = json.dumps(self.summary(), indent=2, allow_nan=False, ensure_ascii=False)
        with replacing(folder / SUMMARY_NAME, "the results") as new:
            new.write_text(text + "\n", encoding="utf-8")

    def _stuck_places(self) -> list[dict[str, Any]]:
        return [
            {
                "person": int(p),
                "level": self.building.levels[self.crowd.level[p]].name,
                "x": self.crowd.position[p, 0],
                "y": self.crowd.position[p, 1],
            }
            for p in self.stuck
        ]


def plain(value: Any) -> Any:
    """Convert a value for JSON: arrays and scalars of numpy to plain data, NaN and infinity to None, others to text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value if value is None or isinstance(value, (str, bool, int, float)) else repr(value)


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file with a header; texts are quoted as by `cell_of`."""
    with replacing(path, "the results") as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(map(cell_of, columns))
        writer.writerows(map(cell_of, row) for row in rows)
