"""Selection of levels by name, and grouping of levels into storeys, for pictures, maps and exports."""

from evac.base.errors import ResultError
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building, Level


def level_of(building: Building, level: str | int) -> Level:
    """Return a level by its name or index."""
    if isinstance(level, int):
        if not 0 <= level < len(building.levels):
            raise ResultError(f"there is no level {level}; the building has levels 0 to {len(building.levels) - 1}")
        return building.levels[level]
    index = building.level_named(level)
    if index is None:
        raise ResultError(
            f"there is no level {level!r}; {did_you_mean(level, [each.name for each in building.levels])}"
        )
    return index


def storeys(building: Building) -> list[tuple[str, list[Level]]]:
    """Return the storeys from the bottom to the top, each with a name and its levels.

    A storey consists of the floors of one height, and the flights and landings between it and the storey above, which
    do not overlap in plan. Flights and landings below the lowest floor belong to the lowest storey.
    """
    floors = [level for level in building.levels if level.kind == "floor"] or list(building.levels)
    heights = sorted({round(level.z_min, 2) for level in floors})
    members: list[list[Level]] = [[] for _ in heights]
    for level in building.levels:
        below = [k for k, height in enumerate(heights) if height <= level.z_min + 0.05]
        members[below[-1] if below else 0].append(level)
    return [
        (", ".join(level.name for level in levels if level.kind == "floor") or levels[0].name, levels)
        for levels in members
        if levels
    ]
