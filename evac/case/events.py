"""The section `[[event]]` of case.toml: what changes during a run, at a time or when something happens."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator, model_validator

from evac.base.change import REMEDIES, is_legal
from evac.base.errors import is_one_line
from evac.base.keys import Fault, Name, Real, Switch, Table, Whole, key, wrong
from evac.base.parameters import did_you_mean
from evac.case.schema import LONGEST_RUN, MOST_PEOPLE
from evac.directions.routes import STRATEGIES

if TYPE_CHECKING:
    from evac.case.case import Case

#: Greatest density [1/m2] that an event can wait for; people cannot stand closer.
MOST_DENSITY = 20.0

#: The conditions of which `when` has one.
CONDITIONS = ("event", "out", "count", "at_most", "density")

#: Those of them that are about the people in an area.
IN_AREA = ("count", "at_most", "density")


def _or_as_given(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    """Return a value of a wrong type as it is: `event_faults` says what the kind of the event needs."""
    try:
        return check(value)
    except ValidationError:
        return value


class WhenSettings(Table):
    """`when` of an event: what makes it happen; exactly one of the keys before `area`."""

    event: str | None = key("name of another event that has happened", "", None)
    out: Whole | None = key("this many people have left the building", "", None, ge=1, le=MOST_PEOPLE)
    count: Whole | None = key("at least this many people are in `area`", "", None, ge=1, le=MOST_PEOPLE)
    at_most: Whole | None = key("at most this many people are in `area`", "", None, ge=0, le=MOST_PEOPLE)
    density: Annotated[Real, Field(gt=0, le=MOST_DENSITY)] | None = key("at least this density in `area`", "1/m2", None)
    area: str | None = key("name of an area or level", "", None)
    after: Real = key("time from then to the event", "s", 0.0, ge=0, le=LONGEST_RUN)

    @model_validator(mode="after")
    def _one_condition(self) -> Self:
        given = [name for name in CONDITIONS if getattr(self, name) is not None]
        if len(given) != 1:
            raise wrong("event", f"give exactly one of {', '.join(CONDITIONS)}, not {' and '.join(given) or 'none'}")
        if (given[0] in IN_AREA) != (self.area is not None):
            fault = (
                f"missing; name the area of {given[0]}" if self.area is None else f"{given[0]} has no area; remove it"
            )
            raise wrong("area", fault)
        return self


class EventSettings(Table):
    """`[[event]]`: a change during the run, at a time or when something happens."""

    name: Name | None = key("name by which other events refer to it", "", None)
    time: Annotated[Real, Field(ge=0, le=LONGEST_RUN)] | None = key("time of the event; this or `when`", "s", None)
    when: WhenSettings | None = key("what makes it happen, once; this or `time`", "", None)
    kind: Literal["open", "close", "one_way", "slow", "bar", "strategy", "alarm"] = key(
        "`open` or `close` an exit, portal, stair or door, or make it `one_way`; `slow` people in an area or on a "
        "level, or `bar` it; change the `strategy` of a group; sound an `alarm`"
    )
    target: str = key(
        "name of what changes: exit, portal, stair, door, area, level or group; of an alarm, an area, a level or a "
        "group, or everybody if not given",
        "",
        "",
    )
    value: Annotated[Switch | Real | str | tuple[str, ...] | None, WrapValidator(_or_as_given)] = key(
        '`one_way`: for portals and stairs "up", "down" or the name of the level to which they lead, for exits "in" or '
        '"out", for doors the name of an area on the side to which they lead; false for both directions; `slow`: the '
        "relative speed, 1 to end it; `bar`: false to end it; `strategy`: the name of a strategy, or a list of exits "
        "or of assembly areas; `alarm`: the share of the response times that people still take",
        "",
        None,
    )

    @model_validator(mode="after")
    def _at_one_time(self) -> Self:
        if (self.time is None) == (self.when is None):
            raise wrong("time", "give either the time of the event (time) or what makes it happen (when)")
        return self

    @property
    def values(self) -> dict[str, Any]:
        """The values of the change."""
        return {} if self.value is None else {"value": self.value}


def event_faults(case: "Case", hears_alarms: bool) -> list[Fault]:
    """Return the faults of events that refer to others, to groups or to behaviours of the case."""
    faults: list[Fault] = []
    names, groups = [one.name for one in case.event], [group.name for group in case.people]
    for index, one in enumerate(case.event):
        found: dict[str, str] = {}
        if one.name is not None and one.name in names[:index]:
            found["name"] = f"{one.name!r} names two events; rename one"
        if not is_legal(one.kind, one.value):
            found["value"] = f"is {one.value!r}; use {REMEDIES[one.kind]}"
        elif one.kind == "strategy" and isinstance(one.value, str) and one.value not in STRATEGIES:
            found["value"] = f"unknown strategy {one.value!r}; {did_you_mean(one.value, STRATEGIES)}"
        if one.kind == "strategy" and one.target not in groups:
            found["target"] = f"there is no group {one.target!r}; {did_you_mean(one.target, groups)}"
        if one.kind == "alarm" and not hears_alarms:
            found["kind"] = "no behaviour of the case acts on an alarm; add one, such as [behaviours.response_time]"
        if one.kind != "alarm" and not one.target:
            found["target"] = f"missing; name what to {one.kind.replace('_', '-')}"
        if not is_one_line(one.target):
            found["target"] = f"{one.target!r:.80} is not one line; correct the name"
        faults += [Fault(("event", index, key), text) for key, text in found.items()]
        other = None if one.when is None else one.when.event
        if other is not None and (other not in names or other == one.name):
            known = [name for name in names if name is not None and name != one.name]
            text = f"there is no other event {other!r}; {did_you_mean(other, known)}"
            faults.append(Fault(("event", index, "when", "event"), text))
        elif other is not None and one.name in (circle := _followed(case.event, one)):
            text = f"the events {', '.join(circle)} wait for each other; give one of them a time or another condition"
            faults.append(Fault(("event", index, "when", "event"), text))
    return faults


def _followed(events: "tuple[EventSettings, ...]", one: EventSettings) -> list[str]:
    """Return the names of the events that an event waits for, one after the other, up to the first one twice."""
    named, found = {event.name: event for event in events if event.name is not None}, list[str]()
    while one.when is not None and (name := one.when.event) in named and name not in found:
        found.append(name)
        one = named[name]
    return found
