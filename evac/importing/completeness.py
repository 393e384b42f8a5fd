"""What an import lacks: storeys, stairs and ground without a way out."""

from collections.abc import Sequence

from evac.base.errors import counted
from evac.building.model.building import Building, Level
from evac.building.model.findings import Finding
from evac.building.model.links import isolated_parts, levels_reaching
from evac.building.model.storeys import storeys

#: Share of the walkable ground that may have no way out, such as a closet without a door.
NEGLIGIBLE = 0.02
#: Number of levels that are named.
MOST_NAMED = 10


def with_missing(building: Building, findings: Sequence[Finding]) -> list[Finding]:
    """Return findings with what the building lacks first, the worst first, in place of warnings that tell the same."""
    if not building.exits:
        return list(findings)
    reached = levels_reaching(building, building.exits)
    floors = [own for _, levels in storeys(building) if (own := [level for level in levels if level.kind == "floor"])]
    closed = [own for own in floors if reached.isdisjoint(level.index for level in own)]
    lacks, told = [], [level for own in closed for level in own]
    if closed:
        verb = "has" if len(closed) == 1 else "have"
        names = _names([own[0] for own in closed])
        lacks.append(f"{len(closed)} of {counted(len(floors), 'storey')} {verb} no way out: {names}")
    ground = sum(level.polygon.area for own in floors for level in own)
    rest = [level for own in floors if own not in closed for level in own if level.index not in reached]
    area = sum(level.polygon.area for level in rest)
    if area > NEGLIGIBLE * ground:
        share = 100.0 * area / ground
        other = " on other storeys" if closed else ""
        lacks.append(f"{area:.1f} m2 of ground ({share:.0f} %){other} have no way out: {_names(rest)}")
        told += rest
    names_told = {level.name for level in told}
    again = {one for one in isolated_parts(building) if one.level in names_told}
    return [*(Finding("missing", text) for text in lacks), *(one for one in findings if one not in again)]


def _names(levels: Sequence[Level]) -> str:
    """Return the names of some levels, of which only the first are written."""
    others = f" and {len(levels) - MOST_NAMED} others" if len(levels) > MOST_NAMED else ""
    return ", ".join(repr(level.name) for level in levels[:MOST_NAMED]) + others
