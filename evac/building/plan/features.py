"""The plan of features of GeoJSON as the export "geojson" writes them: floors, flights, landings, exits and areas."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import shapely

from evac.base.parameters import did_you_mean
from evac.building.plan.plan import Plan
from evac.building.plan.shapes import geometries

#: Kinds of features that follow from the others, or belong to a case.
DERIVED = ("wall", "portal", "door", "refuge", "assembly", "sign", "line")
#: Kinds of features of an exported building.
KINDS = ("floor", "flight", "landing", "exit", "door", "area", *DERIVED)


def are_exported(data: Any) -> bool:
    """Return whether a document is a building as evac exports it."""
    features = data.get("features") if isinstance(data, Mapping) else None
    return isinstance(features, list) and any(_properties(one).get("kind") == "floor" for one in features)


def plan_of_features(features: Sequence[Any], source: Path) -> Plan:
    """Return the plan of an exported building.

    Parameters
    ----------
    features : sequence of dict
        Features with the properties ``kind``, ``name``, ``levels``, and ``z_min`` and ``stair`` of levels.
    source : Path
        For messages.

    Raises
    ------
    ValueError
        A feature lacks a property, or its shape is invalid.
    BuildingError
        The features do not fit together.
    """
    plan = Plan(source, headroom=0.0)
    for number, feature in enumerate(features, start=1):
        own = _properties(feature)
        kind = own.get("kind")
        if kind not in KINDS:
            raise ValueError(f"feature {number}: unknown kind {kind!r}; {did_you_mean(str(kind), KINDS)}")
        if own.get("open") is False:
            plan.note("warning", f"{kind} {own.get('name')!r} was closed at the start; building.closed keeps it so")
        if kind in DERIVED:
            continue
        try:
            shapes = list(geometries(feature))
            name, level = str(own["name"]), str(own["levels"][0])
            if kind == "floor":
                plan.storey(name, shapes, own["z_min"])
            elif kind == "flight":
                plan.flight(str(own["stair"]), polygon=shapes)
            elif kind == "landing":
                plan.landing(str(own["stair"]), shapes, own["z_min"])
            elif kind == "exit":
                lines = [shapely.get_coordinates(line).tolist() for line in shapes]
                plan.exit(name, level, lines[0] if len(lines) == 1 else lines)
            elif kind == "door":
                plan.door(name, level, shapely.get_coordinates(shapes))
            else:
                plan.area(name, level, shapes)
        except (KeyError, IndexError, TypeError) as error:
            text = f"feature {number}: a {kind} needs name, levels, z_min and stair as evac exports them"
            raise ValueError(text) from error
    return plan


def _properties(item: object) -> Mapping[str, Any]:
    """Return the properties of a feature; empty for anything else."""
    found = item.get("properties") if isinstance(item, Mapping) else None
    return found if isinstance(found, Mapping) else {}
