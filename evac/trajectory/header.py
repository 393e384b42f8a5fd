"""The header of a trajectory file: conversion of building and people to and from plain JSON, with checks on reading."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry import mapping, shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Area, Building, Door, Exit, Level, Place, Portal
from evac.building.model.cells import MOST_FIELDS, LevelField
from evac.building.model.findings import as_findings

#: Greatest absolute coordinate [m]; far more than in any coordinate system on Earth.
COORDINATE_MAX = 1e9

KINDS = ("floor", "flight", "landing")
PLACE_KINDS = ("refuge", "assembly", "sign", "line")

#: Kinds of shapes of places that are no areas.
SHAPES = {"sign": ("Point",), "line": ("LineString",)}


class HeaderError(ValueError):
    """A key of a header is missing or has an invalid value; names the key."""


@dataclass(frozen=True)
class People:
    """The people in a trajectory."""

    # radius, height: (n,) float64 [m]
    radius: FloatArray
    height: FloatArray
    group: IntArray  # (n,) int32: index in ``groups`` of each person, -1 for none
    groups: tuple[str, ...]


def building_to_json(building: Building) -> dict[str, Any]:
    """Return the building as lists, numbers and strings; floats are exact."""
    parts = {"levels": building.levels, "portals": building.portals, "exits": building.exits}
    parts |= {"areas": building.areas, "doors": building.doors}
    return {
        "source": building.source.name,
        "vertices": building.vertices.tolist(),
        **{key: [_row_of(part) for part in rows] for key, rows in parts.items()},
        "walls": building.walls.tolist(),
        "wall_level": building.wall_level.tolist(),
        "stairs": {name: list(levels) for name, levels in building.stairs.items()},
        "warnings": list(building.warnings),
        "closed": sorted(building.closed),
        **({"places": [_row_of(place) for place in building.places]} if building.places else {}),
    }


def _row_of(part: Any) -> dict[str, Any]:
    """Return the attributes of a level, portal, exit, area or door, without its index."""
    row: dict[str, Any] = {}
    for key in (field.name for field in fields(part) if field.name != "index"):
        value = getattr(part, key)
        is_shape = isinstance(value, BaseGeometry)
        row[key] = mapping(value) if is_shape else value.tolist() if isinstance(value, np.ndarray) else value
    return row


def building_from_json(data: Any) -> Building:
    """Return the building from the output of `building_to_json`.

    Raises
    ------
    HeaderError
        A key is missing, of the wrong kind, or out of range; names it.
    """
    vertices = _numbers(data, "building", "vertices", (3,), COORDINATE_MAX)
    if not len(vertices):
        raise HeaderError("building.vertices is empty")
    levels = tuple(
        _level_from_json(index, level, f"building.levels.{index}", vertices)
        for index, level in enumerate(_list(data, "building", "levels"))
    )
    n = len(levels)
    if not n:
        raise HeaderError("building.levels is empty")
    portals = tuple(_portal(index, p, n) for index, p in enumerate(_list(data, "building", "portals")))
    exits = tuple(_exit(index, e, n) for index, e in enumerate(_list(data, "building", "exits")))
    walls = _numbers(data, "building", "walls", (4,), COORDINATE_MAX)
    wall_level = _rows(data, "building", "wall_level", n)
    if len(wall_level) != len(walls):
        raise HeaderError(f"building.wall_level has {len(wall_level)} numbers for {len(walls)} walls")
    stairs = _get(data, "building", "stairs", dict)
    doors = tuple(_door(index, d, n) for index, d in enumerate(_list(data, "building", "doors")))
    places = _list(data, "building", "places") if "places" in data else ()
    closed = _rows(data, "building", "closed", len(portals) + len(exits) + len(doors))
    return Building(
        source=Path(_get(data, "building", "source", str)),
        vertices=vertices,
        levels=levels,
        portals=portals,
        exits=exits,
        areas=tuple(_area(index, area, n) for index, area in enumerate(_list(data, "building", "areas"))),
        walls=walls,
        wall_level=wall_level,
        stairs={name: tuple(_rows(stairs, "building.stairs", name, n).tolist()) for name in stairs},
        findings=as_findings(_words(data, "building", "warnings")),
        closed=frozenset(int(link) for link in closed),
        doors=doors,
        places=tuple(_place(index, place, n) for index, place in enumerate(places)),
    )


def people_from_json(data: Any) -> People:
    """Return the people of a header.

    Raises
    ------
    HeaderError
        A key is missing, of the wrong kind, or out of range; names it.
    """
    radius, height = (_numbers(data, "", name, (), COORDINATE_MAX) for name in ("radius", "height"))
    groups = _words(data, "", "groups")
    group = _rows(data, "", "group", len(groups), least=-1)
    for name, lengths in (("radius", radius), ("height", height)):
        if not (lengths > 0.0).all():
            raise HeaderError(f"{name} must be positive")
    for name, numbers in (("height", height), ("group", group)):
        if len(numbers) != len(radius):
            raise HeaderError(f"{name} has {len(numbers)} numbers for {len(radius)} people")
    return People(radius, height, group, groups)


def fields_to_json(given: Iterable[LevelField]) -> list[dict[str, Any]]:
    """Return names, units and cells of fields of behaviours as JSON data."""
    return [{"name": field.name, "unit": field.unit, "spacing": field.spacing} for field in given]


def fields_from_json(data: Any, building: Building) -> tuple[LevelField, ...]:
    """Return the fields of behaviours of a header, with values of zero.

    Raises
    ------
    HeaderError
        A key is missing, of the wrong kind, or out of range; names it.
    """
    rows = _list(data, "", "level_fields")
    if len(rows) > MOST_FIELDS:
        raise HeaderError(f"level_fields has {len(rows)} rows, more than {MOST_FIELDS}")
    fields: dict[str, LevelField] = {}
    for index, row in enumerate(rows):
        key = f"level_fields.{index}"
        name, unit = _get(row, key, "name", str), _get(row, key, "unit", str)
        if name in fields:
            raise HeaderError(f"{key}.name is that of another field")
        try:
            fields[name] = LevelField(building, name, unit, _number(row, key, "spacing", 0.0, COORDINATE_MAX))
        except ValueError as error:
            raise HeaderError(f"{key}: {error}") from error
    return tuple(fields.values())


def origin_from_json(data: Any) -> FloatArray:
    """Return the origin of recorded positions in plan, (2,) [m].

    Raises
    ------
    HeaderError
        The origin is missing or not valid.
    """
    return _numbers(data, "", "origin", (), COORDINATE_MAX, 2)


def _level_from_json(index: int, data: Any, key: str, vertices: FloatArray) -> Level:
    kind, stair = _get(data, key, "kind", str), _get(data, key, "stair", (str, type(None)))
    if kind not in KINDS:
        raise HeaderError(f"{key}.kind is {kind!r:.40}; it must be one of {', '.join(KINDS)}")
    triangles = _rows(data, key, "triangles", len(vertices), (3,))
    if not len(triangles):
        raise HeaderError(f"{key}.triangles is empty")
    a, b, c = vertices[triangles, :2].transpose(1, 0, 2)
    if ((b - a)[:, 0] * (c - a)[:, 1] == (b - a)[:, 1] * (c - a)[:, 0]).any():
        raise HeaderError(f"{key}.triangles contains a triangle without area in plan")
    return Level(
        index=index,
        name=_get(data, key, "name", str),
        kind=kind,
        stair=stair,
        triangles=triangles,
        polygon=_polygon(data, key),
        uphill=_numbers(data, key, "uphill", (), 2.0, 2),
        slope=_number(data, key, "slope", 0.0, 0.5 * pi),
        z_min=_number(data, key, "z_min", -COORDINATE_MAX, COORDINATE_MAX),
        z_max=_number(data, key, "z_max", -COORDINATE_MAX, COORDINATE_MAX),
    )


def _portal(index: int, data: Any, levels: int) -> Portal:
    key = f"building.portals.{index}"
    ends = _rows(data, key, "levels", levels).tolist()
    if len(ends) != 2:
        raise HeaderError(f"{key}.levels has {len(ends)} numbers instead of 2")
    return Portal(index, _get(data, key, "name", str), (ends[0], ends[1]), *_segments(data, key))


def _exit(index: int, data: Any, levels: int) -> Exit:
    key = f"building.exits.{index}"
    return Exit(index, _get(data, key, "name", str), _row(data, key, "level", levels), *_segments(data, key))


def _area(index: int, data: Any, levels: int) -> Area:
    key = f"building.areas.{index}"
    return Area(_get(data, key, "name", str), _row(data, key, "level", levels), _polygon(data, key))


def _place(index: int, data: Any, levels: int) -> Place:
    """Return a place, of which pictures need the kind, the shape and what is written there."""
    key = f"building.places.{index}"
    kind = _get(data, key, "kind", str)
    if kind not in PLACE_KINDS:
        raise HeaderError(f"{key}.kind is {kind!r:.40}; it must be one of {', '.join(PLACE_KINDS)}")
    capacity = _get(data, key, "capacity", (int, type(None)))
    return Place(
        _get(data, key, "name", str),
        kind,
        _row(data, key, "level", levels),
        _shape(data, key, "shape", SHAPES.get(kind, ("Polygon", "MultiPolygon"))),
        _get(data, key, "area", str),
        capacity,
        _get(data, key, "exit", str),
        _number(data, key, "range", 0.0, COORDINATE_MAX),
    )


def _door(index: int, data: Any, levels: int) -> Door:
    key = f"building.doors.{index}"
    segment = _numbers(data, key, "segment", (), COORDINATE_MAX, 4)
    width = _number(data, key, "width", 0.0, COORDINATE_MAX)
    return Door(_get(data, key, "name", str), _row(data, key, "level", levels), segment, width)


def _segments(data: Any, key: str) -> tuple[FloatArray, float]:
    """Return segments and width of a portal or an exit."""
    segments = _numbers(data, key, "segments", (4,), COORDINATE_MAX)
    if not len(segments):
        raise HeaderError(f"{key}.segments is empty")
    return segments, _number(data, key, "width", 0.0, COORDINATE_MAX)


def _polygon(data: Any, key: str) -> BaseGeometry:
    return _shape(data, key, "polygon", ("Polygon", "MultiPolygon"))


def _shape(data: Any, key: str, name: str, kinds: tuple[str, ...]) -> BaseGeometry:
    """Return a geometry of one of some kinds."""
    geometry = _get(data, key, name, dict)
    try:
        found = shape(geometry)
        is_finite = bool(np.isfinite(found.bounds).all())
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError, ShapelyError) as error:
        raise HeaderError(f"{key}.{name} is not a geometry: {error}") from error
    if found.geom_type not in kinds or not is_finite:
        raise HeaderError(f"{key}.{name} is not a {kinds[0].lower()} with finite corners")
    return found


def _get(data: Any, place: str, key: str, kind: type | tuple[type, ...]) -> Any:
    """Return the value of a key, which must exist and have a certain type."""
    name = f"{place}.{key}" if place else key
    if not isinstance(data, Mapping):
        raise HeaderError(f"{place or 'the header'} is not a table")
    if key not in data:
        raise HeaderError(f"{name} is missing")
    if not isinstance(data[key], kind):
        raise HeaderError(f"{name} has the wrong type {type(data[key]).__name__}")
    return data[key]


def _list(data: Any, place: str, key: str) -> Sequence[Any]:
    items: list[Any] = _get(data, place, key, list)
    return items


def _words(data: Any, place: str, key: str) -> tuple[str, ...]:
    words = _list(data, place, key)
    if not all(isinstance(word, str) for word in words):
        raise HeaderError(f"{place + '.' if place else ''}{key} contains a value that is not a string")
    return tuple(words)


def _number(data: Any, place: str, key: str, least: float, greatest: float) -> float:
    value = _get(data, place, key, (int, float))
    if isinstance(value, bool) or not least <= value <= greatest:
        raise HeaderError(f"{place}.{key} is {value!r:.40}; it must be between {least:g} and {greatest:g}")
    return float(value)


def _row(data: Any, place: str, key: str, count: int) -> int:
    value = _get(data, place, key, int)
    if isinstance(value, bool) or not 0 <= value < count:
        raise HeaderError(f"{place}.{key} is {value!r:.40}; it must be between 0 and {count - 1}")
    return int(value)


def _array(data: Any, place: str, key: str, kinds: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return a list of numbers, or of rows of numbers of a given shape, as an array; `kinds` are kinds of numpy."""
    name = f"{place}.{key}" if place else key
    values = _list(data, place, key)
    try:
        array = np.array(values) if values else np.empty((0, *shape), np.int64)
    except (ValueError, OverflowError, RecursionError) as error:
        raise HeaderError(f"{name} is not an array of numbers") from error
    if array.dtype.kind not in kinds or array.shape[1:] != shape:
        what = f"rows of {shape[0]} numbers" if shape else "a list of numbers"
        raise HeaderError(f"{name} must be {what}{'' if 'f' in kinds else ', all of them whole'}")
    return array


def _numbers(
    data: Any, place: str, key: str, shape: tuple[int, ...], greatest: float, count: int | None = None
) -> FloatArray:
    """Return finite numbers between -greatest and greatest, or rows of them; of so many, if a count is given."""
    array = _array(data, place, key, "iuf", shape).astype(np.float64)
    if count not in (None, len(array)):
        raise HeaderError(f"{place + '.' if place else ''}{key} has {len(array)} numbers instead of {count}")
    if not (np.abs(array) <= greatest).all():
        raise HeaderError(f"{place + '.' if place else ''}{key} contains numbers greater than {greatest:g}")
    return array


def _rows(data: Any, place: str, key: str, count: int, shape: tuple[int, ...] = (), least: int = 0) -> IntArray:
    """Return whole numbers from `least` to below `count`."""
    array = _array(data, place, key, "iu", shape)
    if array.size and not (array.min() >= least and array.max() < count):
        raise HeaderError(f"{place + '.' if place else ''}{key} contains numbers outside of {least} to {count - 1}")
    return array.astype(np.int32)
