"""Conditions of the air that a case states itself, or a CSV file."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError, naming
from evac.base.parameters import did_you_mean
from evac.building.model.elevation import elevation
from evac.conditions.source import HOTTEST_START, QUANTITIES, ConditionSource, SourceScene, gap_in

MOST_BYTES = 50_000_000  #: Greatest size of a CSV file [bytes].


@dataclass(frozen=True)
class _Part:
    """Values of each quantity at the times (f,), or one for all, on the levels of which `is_on` (levels,) says so."""

    is_on: NDArray[np.bool_]
    times: FloatArray
    values: dict[str, FloatArray]


class Prescribed(ConditionSource):
    """Values that are the same everywhere on a level, in an area, or in a layer above the floor.

    A CSV file has the columns time, any of the quantities, and level if it describes several levels. The rows of a
    level are sorted by time.
    """

    name = "prescribed"
    keys = ("level", "area", "file", "times", "values", "above", "below")

    def open(self, scene: SourceScene) -> Sequence[str]:
        """Read the values."""
        self._building, settings = scene.building, scene.settings
        self._polygon = None
        self._low = settings.above
        self._high = np.inf if settings.below is None else settings.below
        if self._low >= self._high:
            raise ScenarioError(f"below: {self._high:g} m is not higher than above, {self._low:g} m; raise it")
        levels = scene.levels()
        if settings.area is not None and (area := scene.building.area_named(settings.area)):  # levels() has found it
            self._polygon = area.polygon
            shapely.prepare(area.polygon)
        if (settings.file is None) == (settings.values is None):
            raise ScenarioError("values: give either the values (values), or a CSV file with them (file)")
        if settings.file is None:
            self._parts = [_part_of(scene, levels, settings.times, settings.values)]
        else:
            if settings.times is not None:
                raise ScenarioError("times: belongs to values; the file has times of its own")
            self._parts = _parts_in(scene.file(settings.file), levels, scene)
        self.last = min(float(part.times[-1]) if len(part.times) > 1 else np.inf for part in self._parts)
        self.changes_until = max(float(part.times[-1]) for part in self._parts)
        return tuple(dict.fromkeys(name for part in self._parts for name in part.values))

    def at(
        self, quantities: Sequence[str], time: float, level: IntArray, position: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the values at a time, linear between those that are given."""
        result = np.full((len(quantities), len(level)), np.nan)
        for part in self._parts:
            rows = np.flatnonzero(part.is_on[level])
            if self._polygon is not None:
                rows = rows[shapely.intersects_xy(self._polygon, *position[rows].T)]
            if self._low > 0.0 or self._high < np.inf:
                over = height[rows] - elevation(self._building, level[rows], position[rows])
                rows = rows[(over >= self._low) & (over < self._high)]
            where = rows if len(rows) < len(level) else slice(None)
            for index, name in enumerate(quantities):
                if (values := part.values.get(name)) is not None:
                    result[index, where] = values[0] if len(values) == 1 else np.interp(time, part.times, values)
        return result


def _part_of(scene: SourceScene, levels: list[int], times: Sequence[float] | None, given: Mapping[str, Any]) -> _Part:
    """Return the values of a table."""
    at = np.zeros(1) if times is None else np.array(times, np.float64)
    if not len(at) or at[0] != 0.0 or not (np.diff(at) > 0.0).all() or np.isinf(at[-1]):
        raise ScenarioError("times: must begin with 0 and increase")
    if not given:
        raise ScenarioError("values: there are none; write { extinction = 1.0 }, for example")
    values = {}
    for name, each in given.items():
        if name not in QUANTITIES:
            raise ScenarioError(f"values.{name}: there is no such quantity; {did_you_mean(name, list(QUANTITIES))}")
        numbers, own = np.atleast_1d(np.array(each, np.float64)), QUANTITIES[name]
        if len(numbers) not in (1, len(at)):
            raise ScenarioError(f"values.{name}: {len(numbers)} values for {len(at)} times; give one for each")
        wrong = numbers[~((numbers >= own.least) & (numbers <= own.most))]
        if len(wrong):
            raise ScenarioError(
                f"values.{name}: {wrong[0]:g} {own.unit} is outside [{own.least:g}, {own.most:g}]; correct it"
            )
        is_everywhere = scene.settings.area is None and scene.settings.above == 0.0 and scene.settings.below is None
        if name == "temperature" and (len(numbers) > 1 or is_everywhere) and numbers[0] > HOTTEST_START:
            wrong_unit = f"begins with {numbers[0]:g} C: these are kelvin; subtract 273.15"
            raise ScenarioError(f"values.temperature: {wrong_unit}")
        values[name] = numbers
    return _Part(np.isin(np.arange(len(scene.building.levels)), levels), at, values)


def _parts_in(path: Path, levels: list[int], scene: SourceScene) -> list[_Part]:
    """Return the values in a CSV file, by level."""
    if path.stat().st_size > MOST_BYTES:
        raise ScenarioError(f"{path}: larger than {MOST_BYTES / 1e6:g} MB; give fewer times")
    by_level: dict[str, list[list[float]]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = csv.reader(stream, skipinitialspace=True)
            head = [name.strip() for name in next(lines, [])]
            if "time" not in head or len(set(head)) < len(head):
                needs = f"needs a column 'time', and each column once; got {', '.join(head)!r:.80}"
                raise ScenarioError(f"{path}: line 1: {needs}")
            names = [name for name in head if name not in ("time", "level")]
            for line in filter(None, lines):
                try:
                    row = dict(zip(head, line, strict=True))
                    numbers = [float(row[name]) for name in ("time", *names)]
                except ValueError as error:
                    needs = f"needs {len(head)} cells, with numbers for {', '.join(('time', *names))!s:.80}"
                    raise ScenarioError(f"{path}: line {lines.line_num}: {needs}; correct it") from error
                by_level.setdefault(row.get("level", "").strip(), []).append(numbers)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path}: not a table in CSV: {error}; save it as CSV in UTF-8") from error
    if not by_level:
        raise ScenarioError(f"{path}: has no lines with values; add some")
    parts = []
    known = {level.name: level.index for level in scene.building.levels}
    for level, rows in by_level.items():
        if level and known.get(level) not in levels:
            raise ScenarioError(f"{path}: level: there is no level {level!r}; {did_you_mean(level, list(known))}")
        time, *columns = np.array(rows).T
        with naming(f"{path}: level {level!r}" if level else path):
            own = [known[level]] if level else levels
            parts.append(_part_of(scene, own, time, dict(zip(names, columns, strict=True))))
            if gap := gap_in(time):
                raise ScenarioError(f"{gap}; add the missing lines, or give times and values, which may be far apart")
    return parts
