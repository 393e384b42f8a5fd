"""Reading of the results of a run from its folder: `evac.read_results`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import create_model

from evac.analysis.lines import LineFlow, line_flows
from evac.base.arrays import FloatArray, IntArray
from evac.base.defaults import LEAST_HEIGHT, LEAST_RADIUS
from evac.base.errors import BuildingError, ResultError, usable_path
from evac.base.saved import FINITE
from evac.building.model.building import Building
from evac.building.model.links import building_at
from evac.directions.routes import Route
from evac.folder.files import CROSSINGS_NAME, PEOPLE_NAME, SUMMARY_NAME, TRAJECTORY_NAME
from evac.folder.resultfolder import find_result
from evac.folder.textfiles import checked, read_columns, read_json
from evac.people.population import Group
from evac.physics.state import Crowd, make_crowd
from evac.results import results as kept
from evac.results.recordedcase import CaseTable, GroupTable, Record, recorded_case, with_infinity
from evac.trajectory.trajectory import Trajectory, read_trajectory


def read_results(folder: str | Path, plugin_files: Iterable[str | Path] = ()) -> kept.Results:
    """Read the results of a run from its folder, also of one that was interrupted or has failed.

    Nothing is changed in the folder, and no code that it names is executed. The building is that of the trajectory, if
    one was recorded. The case is loaded when `Results.case` is used for the first time.

    Parameters
    ----------
    folder : str or Path
        Result folder of `evac.run`.
    plugin_files : iterable of path
        Plugin files of the case. They are executed when the case is needed; none is necessary to read the results.

    Returns
    -------
    Results

    Raises
    ------
    ResultError
        The folder contains no results, or a file is damaged or of another run; names the file, and its key or column.

    Examples
    --------
    >>> results = evac.read_results("classroom-result")  # doctest: +SKIP
    >>> results.last_out, results.exits["door"]["people"]  # doctest: +SKIP
    """
    place = find_result(usable_path(folder, ResultError))
    recorded = place / TRAJECTORY_NAME
    trajectory = read_trajectory(recorded) if recorded.is_file() else None
    return results_beside(trajectory, place, tuple(Path(path).resolve() for path in plugin_files))


def recorded_flows(trajectory: Trajectory) -> tuple[LineFlow, ...]:
    """Return `Results.flows` of a recorded run if its results are beside it, else those of doors and lines alone."""
    folder = trajectory.path.parent
    if trajectory.path.name == TRAJECTORY_NAME and all((folder / one).exists() for one in (SUMMARY_NAME, PEOPLE_NAME)):
        return results_beside(trajectory, folder).flows
    return tuple(line_flows(trajectory))


def results_beside(
    trajectory: Trajectory | None, place: Path, plugin_files: tuple[Path, ...] = (), with_people: bool = True
) -> kept.Results:
    """Return the results in a folder, as `read_results` does, with the trajectory that was read from it.

    Without people, only what summary.json contains is read, and the crowd is empty.
    """
    path = place / SUMMARY_NAME
    data = read_json(path)
    results = checked(kept.Results, data | _UNREAD, path)
    derived: Any = checked(_derived(), data, path)
    settings = data["case"]
    case = cache(partial(recorded_case, place, with_infinity(settings), results.source, (), plugin_files))
    results = replace(results, case_or_reader=case, folder=place)
    if trajectory is not None:
        own, written = (trajectory.header.get("seed"), trajectory.number_of_people), (results.seed, derived.people)
        if own != written:
            raise ResultError(
                f"{path}: seed {written[0]} and {written[1]} people, but {trajectory.path.name} has seed {own[0]} and "
                f"{own[1]} people; the files are not of one run: run the case again"
            )
        results = replace(results, building_or_none=_building_at_the_end(trajectory.building, results, place))
    cached = {name: getattr(derived, value.key) for name, value in kept.DERIVED.items()}
    if with_people:
        results = _with_people(results, place, derived)
        for name, value in kept.DERIVED.items():
            if name not in ("flow_totals", "quality_warnings") and getattr(results, name) != cached[name]:
                raise ResultError(
                    f"{place / PEOPLE_NAME}: {value.key!r} is {getattr(results, name)}, but {SUMMARY_NAME} has "
                    f"{cached[name]}; the files are not of one run: run the case again"
                )
    # Cached properties, so that neither files are read nor flows computed again.
    vars(results).update(cached, trajectory=trajectory, case_table=derived.case)
    return results


#: The fields that summary.json must not contain, until they are known.
_UNREAD: dict[str, Any] = {
    "case_or_reader": None,
    "building_or_none": None,
    "crowd": make_crowd(np.zeros((0, 2)), level=0, radius=0.0, mass=0.0, tau=0.0, speed=np.zeros((0, 3))),
    "groups": (),
    "start_position": np.zeros((0, 2)),
    "start_level": np.zeros(0, np.int32),
    "crossings": (np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0)),
    "stuck": (),
    "exposure": {},
    "margins": {},
    "folder": None,
}


@cache
def _derived() -> Any:
    """Return the type of the keys of summary.json that follow from others, and of the case that it contains."""
    kinds: dict[str, Any] = {value.key: (value.kind, ...) for value in kept.DERIVED.values()}
    return create_model("Derived", __base__=Record, case=(CaseTable, ...), **kinds)


def _with_people(results: kept.Results, place: Path, derived: Any) -> kept.Results:
    """Return results with the people of people.csv and their crossings."""
    groups: list[GroupTable] = derived.case.people
    more = () if results.conditions is None else kept.EXPOSURE_COLUMNS
    margins = () if results.safety is None else kept.MARGIN_COLUMNS
    table = _Table(place / PEOPLE_NAME, kept.PEOPLE_COLUMNS + more + margins)
    levels, exits = _told(results.titles), list(results.exits)
    group = table.indices("group", [group.name for group in groups], optional=True)
    crowd = _crowd_of(table, levels, exits, results.routes, group)
    start_level = table.indices("start_level", levels, optional=True, piece="start_piece")
    if (differs := (start_level < 0) != np.isnan(crowd.arrival_time)).any():
        raise table.error("start_level", f"contradicts 'arrival_time' in row {int(np.argmax(differs)) + 2}")
    return replace(
        results,
        crowd=crowd,
        groups=tuple(
            Group(one.name, np.flatnonzero(group == index).astype(np.int32), one.behaviours)
            for index, one in enumerate(groups)
        ),
        start_position=table.pairs("start_x", "start_y"),
        start_level=start_level,
        crossings=_crossings(place / CROSSINGS_NAME, derived.people, results.crossed_titles),
        stuck=tuple(row["person"] for row in derived.stuck),
        exposure={name: table.numbers(name, 0.0, optional=name == "stopped_at") for name in more},
        margins={name: table.numbers(name, optional=True) for name in margins},
    )


class _Table:
    """The columns of a CSV file, checked when they are asked for."""

    def __init__(self, path: Path, columns: tuple[str, ...]) -> None:
        self.path = path
        self._columns = read_columns(path, columns)
        self.length = len(self._columns[columns[0]])

    def numbers(self, name: str, least: float = -FINITE, most: float = FINITE, optional: bool = False) -> FloatArray:
        """Return a column as numbers within bounds; NaN where a field is empty, which only `optional` ones may be."""
        try:
            values = np.array([float(text) if text else np.nan for text in self._columns[name]], np.float64)
        except ValueError as error:
            raise self.error(name, str(error)) from error
        is_valid = (values >= least) & (values <= most) | (np.isnan(values) & optional)
        if not is_valid.all():
            row = int(np.argmin(is_valid))
            raise self.error(name, f"{self._columns[name][row]!r:.40} in row {row + 2} is not valid")
        return values

    def pairs(self, *names: str) -> FloatArray:
        """Return coordinates, (n, 2)."""
        return np.column_stack([self.numbers(name) for name in names])

    def indices(self, name: str, names: Sequence[Any], optional: bool = False, piece: str = "") -> IntArray:
        """Return a column of names as indices in `names`, -1 for empty fields, which only `optional` ones may have.

        With a column of numbers of pieces, `names` are pairs of both.
        """
        texts = [*zip(*(self._columns[one] for one in (name, piece)), strict=True)] if piece else self._columns[name]
        index = {one: k for k, one in enumerate(names)} | ({("", "") if piece else "": -1} if optional else {})
        for text in texts:
            if text not in index:
                raise self.error(name, f"{' '.join(text) if piece else text!r:.80} is not in {SUMMARY_NAME}")
        return np.array([index[text] for text in texts], np.int32)

    def error(self, name: str, why: str) -> ResultError:
        return ResultError(f"{self.path}: column {name!r}: {why}; run the case again")


def _building_at_the_end(building: Building, results: kept.Results, folder: Path) -> Building:
    try:
        return building_at(building, results.changes, results.time)
    except BuildingError as error:
        raise ResultError(f"{folder / SUMMARY_NAME}: changes: {error}; run the case again") from error


def _crowd_of(
    table: _Table, levels: Sequence[tuple[str, str]], exits: Sequence[str], routes: Sequence[Route], group: IntArray
) -> Crowd:
    """Return the people at the end, with NaN for what is not written."""
    n = table.length
    exit_used = table.indices("exit", [*exits, kept.REMOVED], optional=True)
    exit_time = table.numbers("exit_time", 0.0, optional=True)
    level = table.indices("end_level", levels, optional=True, piece="end_piece")
    arrival_time = table.numbers("arrival_time", 0.0, optional=True)
    for name, is_known in (("exit_time", np.isfinite(exit_time)), ("end_level", (level < 0) & ~np.isnan(arrival_time))):
        if (differs := is_known != (exit_used >= 0)).any():
            raise table.error(name, f"contradicts the column 'exit' in row {int(np.argmax(differs)) + 2}")
    return make_crowd(
        table.pairs("end_x", "end_y"),
        velocity=np.nan,
        level=level,
        radius=table.numbers("radius", LEAST_RADIUS),
        contact_radius=np.nan,
        height=table.numbers("height", LEAST_HEIGHT),
        mass=table.numbers("mass", 0.0),
        tau=table.numbers("tau", 0.0),
        speed=np.column_stack([table.numbers(name, 0.0) for name in ("speed", "speed_up", "speed_down")]),
        start_time=table.numbers("response_time", 0.0, np.inf),
    ).replace(
        group=group,
        route=table.indices("route", [str(route) for route in routes]),
        speed_factor=np.full(n, np.nan),
        extra_direction=np.full((n, 2), np.nan),
        exit_time=exit_time,
        arrival_time=arrival_time,
        exit_used=np.where(exit_used < len(exits), exit_used, np.int32(-1)),
        distance=table.numbers("distance", 0.0),
        overlap=np.full(n, np.nan),
        contact_force=np.full(n, np.nan),
    )


def _told(titles: Sequence[tuple[str, int | None]]) -> list[tuple[str, str]]:
    """Return names and numbers of pieces as the tables have them."""
    return [(name, "" if piece is None else str(piece)) for name, piece in titles]


def _crossings(
    path: Path, people: int, links: Mapping[int, tuple[str, int | None]]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return persons, links and times of crossings; none of a building without portals."""
    if not links:
        return np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0)
    table = _Table(path, kept.CROSSINGS_COLUMNS)
    person = table.numbers("person", 0.0, people - 1.0)
    link = np.array([*links], np.int32)[table.indices("portal", _told([*links.values()]), piece="piece")]
    return person.astype(np.int32), link, table.numbers("time", 0.0)
