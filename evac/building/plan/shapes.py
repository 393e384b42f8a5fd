"""Conversion of plane shapes (shapely geometries, WKT, GeoJSON, coordinates) to polygons and segments."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import shapely
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import FARTHEST, LEAST_LENGTH
from evac.base.errors import BuildingError
from evac.building.geometry.overlays import GRID, flat_parts, place_of
from evac.building.model.findings import Finding

#: Accepted representations of a shape: one of these, or a list of them.
Shape: TypeAlias = BaseGeometry | str | Mapping[str, Any] | Sequence[Any]

#: Greatest depth of nested parentheses in WKT: a multipolygon in a collection has five.
MOST_NESTED = 100


@contextmanager
def naming_part(source: Path, part: str) -> Iterator[None]:
    """Prefix a ValueError with a plan and its part, as a BuildingError."""
    try:
        yield
    except ValueError as error:
        raise BuildingError(f"{source}: {part}: {error}") from error


def geometries(given: Shape) -> Iterator[BaseGeometry]:
    """Yield the simple geometries that a shape is made of; collections, nested or not, are flattened.

    Parameters
    ----------
    given : shapely geometry, str, mapping or sequence
        WKT if it is text, GeoJSON (geometry, feature or collection) if it is a mapping; a sequence of points (x, y) is
        the outline of a polygon, any other sequence is a sequence of shapes.
    """
    if isinstance(given, BaseGeometry):
        yield from _simple(given)
    elif isinstance(given, str):
        yield from _simple(from_wkt(given))
    elif isinstance(given, Mapping):
        yield from _of_geojson(given)
    elif isinstance(given, Iterable):
        items = list(given)
        if items and all(is_point(item) for item in items):
            if len(items) < 3:
                raise ValueError(f"an outline needs at least three corners [x, y], not {len(items)}")
            corners = np.array(items, dtype=np.float64)
            if not np.isfinite(corners).all():
                raise ValueError("a coordinate is not finite; correct it")
            yield shapely.Polygon(corners)
        else:
            for item in items:
                yield from geometries(item)
    else:
        raise ValueError(f"a shape must be a shapely geometry, WKT, GeoJSON or a list of corners, not {given!r}")


def from_wkt(text: str) -> BaseGeometry:
    """Parse WKT; raise ValueError if it is invalid, or nested so deep that GEOS would overflow its stack."""
    ends = np.frombuffer(text.encode("utf-8", "replace"), np.uint8)
    depth = (ends == ord("(")).astype(np.int64) - (ends == ord(")"))
    if depth.cumsum().max(initial=0) > MOST_NESTED:
        raise ValueError(f"WKT nested more than {MOST_NESTED} deep")
    try:
        with np.errstate(invalid="ignore"):
            return shapely.from_wkt(text)
    except shapely.GEOSException as error:
        raise ValueError(f"invalid WKT: {error}") from error


def polygons_of(given: Shape, level: str | None, findings: list[Finding]) -> list[BaseGeometry]:
    """Return the valid polygons of a part on the grid of plans; add a finding for each repair or omission."""
    shapes: list[BaseGeometry] = []
    others: list[BaseGeometry] = []
    for part in geometries(given):
        corners = shapely.get_coordinates(part)
        if not (np.abs(corners) <= FARTHEST).all():  # nor NaN
            raise ValueError(f"a coordinate is not finite, or farther than {FARTHEST:g} m from the origin; correct it")
        if part.geom_type == "Polygon":
            shapes += _valid(shapely.force_2d(part), level, findings)
        elif not part.is_empty:
            others.append(part)
    if others:
        kinds = ", ".join(sorted({part.geom_type for part in others}))
        text = f"{len(others)} shapes that are not polygons ({kinds}); the first one is here"
        findings.append(Finding("left out", text, level, place_of(others[0])))
    if not shapes:
        raise ValueError("the part contains no polygon with an area")
    return shapes


def inclined_of(given: Shape) -> tuple[BaseGeometry, ...]:
    """Return polygons whose corners have heights [m]."""
    parts = list(geometries(given))
    for part in parts:
        corners = shapely.get_coordinates(part, include_z=True)
        if part.geom_type != "Polygon" or not part.has_z or not (np.abs(corners) <= FARTHEST).all():
            raise ValueError("an inclined polygon needs corners with heights, such as POLYGON Z ((0 0 0, 1 0 0, ...))")
        if not part.is_valid or part.area < LEAST_LENGTH:
            raise ValueError(f"an inclined polygon is not valid: {shapely.is_valid_reason(part)}; correct its corners")
    return tuple(shapely.transform(part, lambda xyz: np.round(xyz, 6) + 0.0, include_z=True) for part in parts)


def segment_of(given: Shape) -> FloatArray:
    """Return the two ends (2, 2) [m] of a segment, given as a line, as WKT or GeoJSON of one, or as two points."""
    if isinstance(given, (str, Mapping)):
        lines = list(geometries(given))
        given = lines[0] if len(lines) == 1 else []
    try:
        ends = shapely.get_coordinates(given) if isinstance(given, BaseGeometry) else np.array(given, np.float64)
    except (TypeError, ValueError, OverflowError):
        ends = np.empty(0)
    if ends.shape != (2, 2) or not (np.abs(ends) <= FARTHEST).all() or np.hypot(*(ends[1] - ends[0])) < LEAST_LENGTH:
        raise ValueError(
            f"a segment must be two different points [[x1, y1], [x2, y2]], at most {FARTHEST:g} m from the "
            f"origin, not {given!r}"
        )
    rounded: FloatArray = np.round(ends, 6) + 0.0
    return rounded


def _simple(geometry: BaseGeometry) -> Iterator[BaseGeometry]:
    """Yield the simple parts of a geometry, which may be nested."""
    if geometry.geom_type.startswith("Multi") or geometry.geom_type == "GeometryCollection":
        for part in geometry.geoms:
            yield from _simple(part)
    else:
        yield geometry


def _of_geojson(given: Mapping[str, Any]) -> Iterator[BaseGeometry]:
    """Yield the geometries of a GeoJSON object."""
    kind = given.get("type")
    if kind == "FeatureCollection":
        for feature in given.get("features", ()):
            yield from _of_geojson(feature)
    elif kind == "Feature":
        if given.get("geometry") is not None:
            yield from _of_geojson(given["geometry"])
    else:
        try:
            with np.errstate(invalid="ignore"):
                made = shape(given)
            yield from _simple(made)
        except (shapely.GEOSException, AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise ValueError(f"invalid GeoJSON geometry of type {kind!r}: {error}") from error


def is_point(item: Any) -> bool:
    """Return whether a value is a point [x, y]."""
    return (
        isinstance(item, Sequence | np.ndarray)
        and not isinstance(item, str)
        and len(item) == 2
        and all(isinstance(value, int | float | np.number) and not isinstance(value, bool) for value in item)
    )


def _valid(polygon: BaseGeometry, level: str | None, findings: list[Finding]) -> list[BaseGeometry]:
    """Return a polygon repaired, as valid polygons."""
    if polygon.is_empty:
        return []
    if not polygon.is_valid:
        reason, _, at = shapely.is_valid_reason(polygon).rstrip("]").partition("[")
        x, y = map(float, at.split()[:2]) if at else shapely.get_coordinates(polygon)[0].tolist()
        repaired = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
        text = f"an outline that crosses itself here ({reason}), of which {repaired.area:.2f} m2 are kept"
        findings.append(Finding("repaired", text, level, (x, y)))
        polygon = repaired
    snapped = flat_parts(shapely.set_precision(polygon, GRID))
    if snapped.is_empty:
        place = tuple(shapely.get_coordinates(polygon)[0].tolist()) if not polygon.is_empty else None
        findings.append(Finding("left out", "a polygon without an area", level, place))
    return [part for part in shapely.get_parts(shapely.normalize(snapped))]
