"""The header of a trajectory file: conversion of building and people to and from plain JSON, with checks on reading."""

from collections.abc import Iterable
from dataclasses import fields
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, ValidationInfo, field_validator
from shapely.errors import ShapelyError
from shapely.geometry import mapping, shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Area, Building, Door, Exit, Level, Place, Portal
from evac.building.model.cells import MOST_FIELDS, LevelField
from evac.building.model.findings import as_findings
from evac.folder.jsonfile import first_fault

#: Greatest absolute coordinate [m]; far more than in any coordinate system on Earth.
COORDINATE_MAX = 1e9

#: Kinds of shapes of places that are no areas, and of areas.
SHAPES = {"sign": ("Point",), "line": ("LineString",)}
GROUND = ("Polygon", "MultiPolygon")

Read = TypeVar("Read", bound=BaseModel)


class HeaderError(ValueError):
    """A key of a header is missing or has an invalid value; names the key."""


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


def _array(*row: int, least: int = 0, count: int | None = None, whole: bool = False) -> PlainValidator:
    """Return the check of a list of at least so many numbers, or of `count`, or of rows of numbers: an array."""

    def convert(values: Any) -> NDArray[Any]:
        if not isinstance(values, list):
            raise ValueError("is not a list")
        try:
            array = np.array(values) if values else np.empty((0, *row), np.int64)
        except (ValueError, OverflowError, RecursionError) as error:
            raise ValueError("is not an array of numbers") from error
        if array.dtype.kind not in ("iu" if whole else "iuf") or array.shape[1:] != row:
            what = f"rows of {row[0]} numbers" if row else "a list of numbers"
            raise ValueError(f"must be {what}{', all of them whole' if whole else ''}")
        if len(array) < least or count not in (None, len(array)):
            raise ValueError(f"has {len(array)} rows instead of {count or f'at least {least}'}")
        if not ((array >= -COORDINATE_MAX) & (array <= COORDINATE_MAX)).all():
            raise ValueError(f"contains numbers greater than {COORDINATE_MAX:g}")
        return array.astype(np.int32 if whole else np.float64)

    return PlainValidator(convert)


def _shape(geometry: Any, kinds: tuple[str, ...] = GROUND) -> BaseGeometry:
    """Return a geometry of one of some kinds."""
    try:
        found = shape(geometry)
        is_finite = bool(np.isfinite(found.bounds).all())
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError, ShapelyError) as error:
        raise ValueError(f"is not a geometry: {error}") from error
    if found.geom_type not in kinds or not is_finite:
        raise ValueError(f"is not a {kinds[0].lower()} with finite corners")
    return found


Segments = Annotated[FloatArray, _array(4, least=1)]
Ground = Annotated[BaseGeometry, PlainValidator(_shape)]
Height = Annotated[float, Field(ge=-COORDINATE_MAX, le=COORDINATE_MAX)]
Length = Annotated[float, Field(ge=0.0, le=COORDINATE_MAX)]


class _Row(BaseModel):
    """The attributes of a part of a building without its index; keys that are not known are left out."""

    model_config = ConfigDict(strict=True, extra="ignore", arbitrary_types_allowed=True, allow_inf_nan=False)


class _LevelRow(_Row):
    name: str
    kind: Literal["floor", "flight", "landing"]
    stair: str | None
    triangles: Annotated[IntArray, _array(3, least=1, whole=True)]
    polygon: Ground
    uphill: Annotated[FloatArray, _array(count=2)]
    slope: Annotated[float, Field(ge=0.0, le=0.5 * pi)]
    z_min: Height
    z_max: Height


class _PortalRow(_Row):
    name: str
    levels: Annotated[IntArray, _array(count=2, whole=True)]
    segments: Segments
    width: Length


class _ExitRow(_Row):
    name: str
    level: int
    segments: Segments
    width: Length


class _AreaRow(_Row):
    name: str
    level: int
    polygon: Ground


class _DoorRow(_Row):
    name: str
    level: int
    segment: Annotated[FloatArray, _array(count=4)]
    width: Length


class _PlaceRow(_Row):
    name: str
    kind: Literal["refuge", "assembly", "sign", "line"]
    level: int
    shape: Any
    area: str
    capacity: int | None
    exit: str
    range: Length

    @field_validator("shape")
    @classmethod
    def _of_kind(cls, value: Any, info: ValidationInfo) -> BaseGeometry:
        return _shape(value, SHAPES.get(info.data.get("kind", ""), GROUND))


class _BuildingRow(_Row):
    source: str
    vertices: Annotated[FloatArray, _array(3, least=1)]
    levels: Annotated[list[_LevelRow], Field(min_length=1)]
    portals: list[_PortalRow]
    exits: list[_ExitRow]
    areas: list[_AreaRow]
    doors: list[_DoorRow]
    walls: Annotated[FloatArray, _array(4)]
    wall_level: Annotated[IntArray, _array(whole=True)]
    stairs: dict[str, Annotated[IntArray, _array(whole=True)]]
    warnings: list[str]
    closed: Annotated[IntArray, _array(whole=True)]
    places: list[_PlaceRow] = []


class _FieldRow(_Row):
    name: str
    unit: str
    spacing: Length


class Header(_Row):
    """The keys of a header besides the building."""

    origin: Annotated[FloatArray, _array(count=2)]  # (2,) float64: of recorded positions in plan [m]
    # radius, height: (n,) float64, of each person [m]
    radius: Annotated[FloatArray, _array()]
    height: Annotated[FloatArray, _array()]
    groups: list[str]
    group: Annotated[IntArray, _array(whole=True)]  # (n,) int32: index in ``groups`` of each person, -1 for none
    level_fields: Annotated[list[_FieldRow], Field(max_length=MOST_FIELDS)]
    contrast: Annotated[float, Field(ge=1.0, le=20.0)] = 1.0
    arriving: list[str] = []


def _read(kind: type[Read], data: Any, place: str = "") -> Read:
    """Return checked data of a place of a header."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise HeaderError(f"{place}{first_fault(error)}") from error


def building_from_json(data: Any) -> Building:
    """Return the building from the output of `building_to_json`."""
    found = _read(_BuildingRow, data, "building.")
    n = len(found.levels)
    _check_rows("wall_level", found.wall_level, n)
    _check_rows("closed", found.closed, len(found.portals) + len(found.exits) + len(found.doors))
    for name, levels in found.stairs.items():
        _check_rows(f"stairs.{name}", levels, n)
    for index, level in enumerate(found.levels):
        _check_rows(f"levels.{index}.triangles", level.triangles, len(found.vertices))
        a, b, c = found.vertices[level.triangles, :2].transpose(1, 0, 2)
        if ((b - a)[:, 0] * (c - a)[:, 1] == (b - a)[:, 1] * (c - a)[:, 0]).any():
            raise HeaderError(f"building.levels.{index}.triangles contains a triangle without area in plan")
    for index, portal in enumerate(found.portals):
        _check_rows(f"portals.{index}.levels", portal.levels, n)
    for key in ("exits", "areas", "doors", "places"):
        for index, part in enumerate(getattr(found, key)):
            _check_rows(f"{key}.{index}.level", np.array(part.level), n)
    if len(found.wall_level) != len(found.walls):
        raise HeaderError(f"building.wall_level has {len(found.wall_level)} numbers for {len(found.walls)} walls")
    portals = enumerate(found.portals)
    return Building(
        source=Path(found.source),
        vertices=found.vertices,
        levels=tuple(Level(index, **dict(one)) for index, one in enumerate(found.levels)),
        portals=tuple(Portal(k, one.name, tuple(one.levels.tolist()), one.segments, one.width) for k, one in portals),
        exits=tuple(Exit(index, **dict(one)) for index, one in enumerate(found.exits)),
        areas=tuple(Area(**dict(one)) for one in found.areas),
        walls=found.walls,
        wall_level=found.wall_level,
        stairs={name: tuple(levels.tolist()) for name, levels in found.stairs.items()},
        findings=as_findings(tuple(found.warnings)),
        closed=frozenset(found.closed.tolist()),
        doors=tuple(Door(**dict(one)) for one in found.doors),
        places=tuple(Place(**dict(one)) for one in found.places),
    )


def _check_rows(key: str, rows: IntArray, count: int, least: int = 0) -> None:
    """Check that whole numbers are those of rows, from `least` to below `count`."""
    if rows.size and not (rows.min() >= least and rows.max() < count):
        raise HeaderError(f"building.{key} contains numbers outside of {least} to {count - 1}")


def read_header(data: Any) -> tuple[Building, Header, tuple[LevelField, ...]]:
    """Return the building, the other keys, and the fields of behaviours with values of zero."""
    found, building = _read(Header, data), building_from_json(data.get("building"))
    people = len(found.radius)
    for key in ("radius", "height", "group"):
        numbers = getattr(found, key)
        if len(numbers) != people:
            raise HeaderError(f"{key} has {len(numbers)} numbers for {people} people")
        if key != "group" and not (numbers > 0.0).all():
            raise HeaderError(f"{key} must be positive")
    _check_rows("group", found.group, len(found.groups), -1)
    fields: dict[str, LevelField] = {}
    for index, row in enumerate(found.level_fields):
        if row.name in fields:
            raise HeaderError(f"level_fields.{index}.name is that of another field")
        try:
            fields[row.name] = LevelField(building, row.name, row.unit, row.spacing)
        except ValueError as error:
            raise HeaderError(f"level_fields.{index}: {error}") from error
    return building, found, tuple(fields.values())


def fields_to_json(given: Iterable[LevelField]) -> list[dict[str, Any]]:
    """Return names, units and cells of fields of behaviours as JSON data."""
    return [{"name": field.name, "unit": field.unit, "spacing": field.spacing} for field in given]
