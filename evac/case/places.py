"""The section `[[place]]` of case.toml: areas with a task in the evacuation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from evac.base.keys import Fault, Name, Table, Whole, key
from evac.base.parameters import did_you_mean
from evac.case.schema import MOST_PEOPLE

if TYPE_CHECKING:
    from evac.case.case import Case


class PlaceSettings(Table):
    """`[[place]]`: an area with a task in the evacuation."""

    name: Name = key("name of the place")
    kind: Literal["refuge", "assembly"] = key(
        "refuge: people whose group has `steepest` or `turns = false`, and who have no way out of the building that is "
        "as wide as they are, go there and stay; assembly: groups go there that name it in `assembly`, or that an "
        "event sends there"
    )
    area: str = key("name of the area of the building")
    capacity: Whole | None = key(
        "greatest number of people; if not given, there is no limit", "", None, ge=1, le=MOST_PEOPLE
    )


def place_faults(case: "Case", groups: Sequence[Any]) -> list[Fault]:
    """Return the faults of places, and of groups and events that name them.

    Parameters
    ----------
    case : Case
    groups : sequence of str
        Names of the groups in the order of the tables.
    """
    faults: list[Fault] = []
    for index, place in enumerate(case.place):
        if any(place.name == other.name or place.area == other.area for other in case.place[:index]):
            faults.append(Fault(("place", index, "name"), f"{place.name!r}: another place has this name or area"))
    known = [place.name for place in case.place if place.kind == "assembly"]
    for group in case.people:
        for name in group.assembly:
            if name not in known:
                text = f"there is no place {name!r} of kind assembly; {did_you_mean(name, known)}"
                faults.append(Fault(("people", groups.index(group.name), "assembly"), text))
    for index, event in enumerate(case.event):
        named = set(event.value) if event.kind == "strategy" and isinstance(event.value, tuple) else set()
        if named & {*known} and not named <= {*known}:
            faults.append(Fault(("event", index, "value"), "name either exits or assembly areas, not both"))
    return faults
