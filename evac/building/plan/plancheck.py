"""What is unlikely to be meant in a plan: low storeys, areas beside the floor, and repairs that may cause an error."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH
from evac.building.geometry.overlays import common, cut, place_of, united
from evac.building.geometry.segments import between_floors, segment_lengths
from evac.building.model.findings import Finding
from evac.building.plan.planparts import Item, Storey

#: Smallest overlap of two floors, and smallest part of an area beside its floor, that is reported [m2].
LEAST_REPORTED = 0.05
#: Share of an area beside its floor above which it is a warning.
MOST_BESIDE = 0.05


def low_storeys(
    storeys: Mapping[str, Storey], floors: Mapping[str, BaseGeometry], headroom: float
) -> Iterable[Finding]:
    """Warn of floors that overlap in plan with less than `headroom` [m] between them."""
    for lower, upper in itertools.combinations(sorted(storeys.values(), key=lambda storey: storey.z), 2):
        height = upper.z - lower.z
        if 0.0 < height < headroom:
            both = common(floors[lower.name], floors[upper.name])
            if both.area > LEAST_REPORTED:
                yield Finding(
                    "warning",
                    f"storey {upper.name!r} is only {height:.2f} m above storey {lower.name!r}, less than the headroom "
                    f"of {headroom:g} m, where {both.area:.2f} m2 of their floors overlap; check z of both",
                    upper.name,
                    place_of(both),
                )


def beside_floor(areas: Sequence[Item], rooms: Mapping[str, BaseGeometry]) -> Iterable[Finding]:
    """Report the parts of areas that are not on the floor of their storey, which do not belong to the areas."""
    for item in areas:
        outline = united(item.polygons)
        rest = cut(outline, rooms[item.storey])
        if rest.area > LEAST_REPORTED:
            yield Finding(
                "warning" if rest.area > MOST_BESIDE * outline.area else "left out",
                f"{rest.area:.2f} of the {outline.area:.2f} m2 of area {item.name!r} are not on the floor",
                item.storey,
                place_of(rest),
            )


def both_sides(item: Item, floor: BaseGeometry, pieces: FloatArray) -> Iterable[Finding]:
    """Warn of an exit given as a polygon that has floor on both its sides, whose width counts both."""
    length = segment_lengths(pieces)
    if length[between_floors(floor, pieces, DOOR_REACH)].sum() > 0.5 * length.sum():
        yield Finding(
            "warning",
            f"exit {item.name!r} has floor on both its sides, which both count for its width of {length.sum():.2f} m; "
            "if it lies between two rooms, make it a door",
            item.storey,
            place_of(united(item.polygons)),
        )


def with_cause(message: str, source: Path, findings: Iterable[Finding]) -> str:
    """Put the repairs of outlines of the storeys that an error names before its message: it may follow from them."""
    told = [str(finding) for finding in findings if finding.kind == "repaired" and repr(finding.level) in message]
    if not told:
        return message
    return (
        f"{source}: {'; '.join(told)}; correct its corners first, since this error may follow: "
        + message.removeprefix(f"{source}: ")
    )
