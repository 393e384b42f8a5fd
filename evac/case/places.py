"""The sections `[[place]]` and `[[line]]` of case.toml: areas with a task in the evacuation, signs, and lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from evac.base.defaults import SIGN_RANGE
from evac.base.keys import Coordinate, Fault, Name, Point, Real, Table, Whole, key, wrong
from evac.base.parameters import did_you_mean
from evac.building.options import check_level
from evac.case.schema import MOST_PEOPLE

if TYPE_CHECKING:
    from evac.case.case import Case


class PlaceSettings(Table):
    """`[[place]]`: an area with a task in the evacuation."""

    name: Name = key("name of the place")
    kind: Literal["refuge", "assembly", "sign"] = key(
        "refuge: people whose group has `steepest` or `turns = false`, and who have no way out that they fit through, "
        "go there and stay; assembly: destination of groups that name it in `assembly`, or that an event sends there; "
        "sign: shows people the way to an exit, if a behaviour such as `familiarity` follows signs"
    )
    area: str | None = key("name of the area of the building, for a refuge or assembly area", "", None)
    capacity: Whole | None = key(
        "greatest number of people; if not given, there is no limit", "", None, ge=1, le=MOST_PEOPLE
    )
    position: Point | None = key("position of a sign [x, y], about 0.1 m in front of its wall", "m", None)
    z: Coordinate | None = key("height of the floor under a sign; this or `level`", "m", None)
    level: str | None = key("name of the level of a sign; this or `z`", "", None)
    exit: str | None = key("name of the exit that a sign shows", "", None)
    range: Annotated[Real, Field(gt=0, le=1000)] | None = key(
        f"distance from which a sign is seen; if not given, {SIGN_RANGE:g} m. In EN 1838 it is 200 times the height "
        "of internally lit signs, and 100 times that of others",
        "m",
        None,
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        own = ("position", "exit") if self.kind == "sign" else ("area",)
        others = ("area", "capacity") if self.kind == "sign" else ("position", "exit", "level", "z", "range")
        for name in own:
            if getattr(self, name) is None:
                raise wrong(name, f"missing; a place of kind {self.kind} needs it")
        for name in others:
            if getattr(self, name) is not None:
                raise wrong(name, f"a place of kind {self.kind} has no {name}; remove it")
        if self.kind == "sign":
            check_level("the level of the sign", self.level, self.z)
        return self


class LineSettings(Table):
    """`[[line]]`: a line through which people are counted."""

    name: Name = key("name of the line")
    level: str = key("name of its level", "", min_length=1)
    segment: tuple[Point, Point] = key("its ends [[x1, y1], [x2, y2]]", "m")

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.segment[0] == self.segment[1]:
            raise wrong("segment", "its ends are the same point; move one of them")
        return self


def place_faults(case: "Case", groups: Sequence[Any], follows_signs: bool) -> list[Fault]:
    """Return the faults of places, and of groups and events that name them."""
    faults: list[Fault] = []
    for index, place in enumerate(case.place):
        if any(place.name == other.name or place.area == other.area is not None for other in case.place[:index]):
            faults.append(Fault(("place", index, "name"), f"{place.name!r}: another place has this name or area"))
        if place.kind == "sign" and not follows_signs:
            text = "no behaviour of the case follows signs; add one, such as [behaviours.familiarity]"
            faults.append(Fault(("place", index, "kind"), text))
    for index, line in enumerate(case.line):
        if line.name in [other.name for other in case.line[:index]]:
            faults.append(Fault(("line", index, "name"), f"{line.name!r} names two lines; rename one"))
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
