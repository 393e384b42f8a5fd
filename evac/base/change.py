"""Changes of a scene during a run: plain records, which are applied by the scene and recorded in the trajectory."""

import numbers
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Self, TypeVar

from pydantic import Field, ValidationError, model_validator

from evac.base.errors import is_one_line
from evac.base.keys import Name, Real, Switch, Table, Whole, key, wrong

Described = TypeVar("Described", bound=Table)

#: Least share of their speeds at which people walk in a slow area; areas that nobody shall enter are barred.
LEAST_SHARE = 0.01

#: Values of a change that closes a link for bodies alone, so that ways lead through it and people wait; that closes a
#: stair to those who would enter it, until those on it have left; and that closes it at once.
BODIES, LEAVE, ALL = "bodies", "leave", "all"

#: Kind of the changes of lifts, and what a car does: at one storey, or from one to another.
LIFT = "lift"
OPENS, CLOSES, LEAVES, ARRIVES = "opens at", "closes at", "leaves", "arrives from"

#: How each value closes a link, for a person.
CLOSED = {BODIES: "closed for bodies alone", LEAVE: "closed to those who would enter"}


class Control(Table):
    """How an exit, portal or door lets people through: one after the other, so many, or when its leaf is open."""

    every: Real | None = key("least time between two people who are let through", "s", None, gt=0, le=3600)
    most: Whole | None = key("number of people after whom it closes", "", None, ge=1, le=1_000_000)
    delay: Real | None = key(
        "time after which its leaf opens when somebody has come before it", "s", None, ge=0, le=3600
    )
    hold: Real | None = key(
        "time after which its leaf closes when nobody is before it any more", "s", None, ge=0, le=3600
    )

    def __str__(self) -> str:
        words = "one person in {:g} s", "closes after {} people", "opens after {:g} s", "closes by itself after {:g} s"
        values = self.every, self.most, self.delay, self.hold
        return ", ".join(text.format(value) for text, value in zip(words, values, strict=True) if value is not None)

    @model_validator(mode="after")
    def _controls(self) -> Self:
        if not self.model_fields_set:
            raise wrong("every", "missing; give every, most, delay or hold")
        return self


class Moving(Table):
    """How the ground of an escalator or a moving walkway moves; while it does, it is passed in this direction only."""

    speed: Real = key("speed of the ground along the slope", "m/s", gt=0, le=2)
    towards: Name | Annotated[Real, Field(ge=-360, le=360)] = key(
        'where to: "up", "down", the name of the level ahead, or the direction in plan, counterclockwise from x '
        "[degrees]",
        "",
        "up",
    )

    def __str__(self) -> str:
        where = self.towards if isinstance(self.towards, str) else f"{self.towards:g} degrees"
        return f"{where} at {self.speed:g} m/s"


class LiftOptions(Table):
    """`[building.lifts.NAME]`, and `operation` of a lift of a plan: how its car moves, and whom it carries."""

    capacity: Whole = key("greatest number of people in the car", "", 13, ge=1, le=1000)
    load: Real | None = key("greatest mass of the people in the car; if not given, any", "kg", None, gt=0, le=1e5)
    speed: Real = key("rated speed", "m/s", 1.0, gt=0, le=20)
    acceleration: Real = key("greatest acceleration", "m/s2", 0.8, gt=0, le=3)
    jerk: Real = key("greatest jerk", "m/s3", 1.0, gt=0, le=5)
    start_delay: Real = key("time from closed doors to the start", "s", 0.5, ge=0, le=60)
    opening: Real = key("time in which the doors open", "s", 2.0, ge=0, le=60)
    closing: Real = key("time in which the doors close", "s", 3.0, ge=0, le=60)
    dwell: Real = key("time after the last person has come in, after which the doors close", "s", 5.0, ge=0, le=600)
    discharge: str | None = key("storey at which people get out; if not given, the lowest", "", None)
    start: str | None = key("storey at which the car is at first; if not given, that of `discharge`", "", None)
    bank: str | None = key("lifts with the same name here serve their lobbies together", "", None)
    service: Switch = key("whether it runs; the events `open` and `close` with its name change that", "", True)
    wait: Real = key("wait that people expect before they are taken in", "s", 30.0, ge=0, le=3600)


#: What the value of each kind of change may be.
REMEDIES = {
    "open": "no value",
    "close": f'no value, "{BODIES}" for bodies alone, or for a stair "{LEAVE}" or "{ALL}"',
    "no_entry": "no value, or false to lift it",
    "control": "a table with every, most, delay or hold, or false to lift it",
    "one_way": '"up", "down", "in", "out", the name of the level or area ahead, or false for both directions',
    "move": "a table with speed and towards, or false to stop it",
    "slow": f"a share of the speed from {LEAST_SHARE:g} to 1",
    "bar": "no value, or false to lift it",
    "strategy": "the name of a strategy, or a list of exits or of assembly areas",
    "alarm": "a share of the response times from 0 to 1, or no value",
    LIFT: "what the car does, and one or two storeys; runs list such changes, and cases do not name them",
}


def is_legal(kind: str, value: Any) -> bool:
    """Return whether a value can belong to a change of a kind; None means that it has none."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    match kind:
        case "close":
            return value in (None, BODIES, LEAVE, ALL)
        case "no_entry":
            return value is None or value is False
        case "control":
            return value is False or (isinstance(value, dict) and control_of(value) is not None)
        case "move":
            return value is False or (isinstance(value, dict) and moving_of(value) is not None)
        case "one_way":
            return value is False or _is_text(value)
        case "slow":
            return is_number and LEAST_SHARE <= value <= 1.0
        case "bar":
            return value is None or isinstance(value, bool)
        case "strategy":
            return _is_text(value) or (isinstance(value, tuple) and all(map(_is_text, value)))
        case "lift":
            names = {OPENS: 2, CLOSES: 2, LEAVES: 3, ARRIVES: 3}
            return isinstance(value, tuple) and len(value) == names.get(*value[:1] or ("",))
        case "alarm":
            return value is None or (is_number and 0.0 <= value <= 1.0)
    return value is None


@dataclass(frozen=True)
class Change:
    """One change of a scene."""

    time: float  #: time at which it takes effect, the beginning of a tick [s]
    #: ``open``, ``close``, ``one_way`` or ``control`` for exits, portals, stairs and doors, ``move`` for stairs,
    #: ``no_entry``, ``slow`` or ``bar`` for areas, levels and stairs, ``strategy`` for groups, ``alarm`` for areas,
    #: levels, groups or, with an empty name, everybody; ``lift`` for lifts, as a run lists them
    kind: str
    what: str  #: name of what changes
    #: further values of this kind of change, such as ``value``; when a link has closed, ``let_through`` lists the
    #: people whose bodies were on its line, see docs/summary.md
    values: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        what = f"change {self.kind!r:.80} of {self.what!r:.80}"
        if not all(isinstance(text, str) and is_one_line(text) for text in (self.kind, self.what)):
            raise ValueError(f"{what}: kind and name must be texts of one line")
        if not (isinstance(self.time, numbers.Real) and abs(self.time) <= sys.float_info.max):
            raise ValueError(f"time of the {what}: {self.time!r:.80} is not a finite number")
        if not isinstance(self.values, Mapping):
            raise ValueError(f"values of the {what}: {self.values!r:.80} is not a dictionary")
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in self.values.items()}
        for name, value in values.items():
            parts = [*value, *value.values()] if isinstance(value, dict) else value
            parts = parts if isinstance(parts, tuple | list) else [parts]
            if not isinstance(name, str) or not all(map(_is_plain, parts)):
                wrong_one = f"{name!r:.80} is {value!r:.80}"
                raise ValueError(
                    f"values of the {what}: {wrong_one}; use names, with finite numbers and texts of one line"
                )
        people = values.get("let_through", ())
        if not (isinstance(people, tuple) and all(type(person) is int and person >= 0 for person in people)):
            raise ValueError(f"values of the {what}: let_through is {people!r:.80}, not a list of people")
        object.__setattr__(self, "time", float(self.time))
        object.__setattr__(self, "values", values)

    def __str__(self) -> str:
        return f"{self.words} at {self.time:g} s"

    @property
    def words(self) -> str:
        """What happens to what, without the time."""
        return f"{self.whom} {self.done}"

    @property
    def whom(self) -> str:
        """What it happens to."""
        return repr(self.what) if self.what else "everybody"

    @property
    def done(self) -> str:
        """What happens to it."""
        value, ends = self.values.get("value"), self.values.get("value") is False
        done = {
            "open": "opened",
            "close": CLOSED.get(str(value), "closed"),
            "no_entry": "open to those who would enter" if ends else "closed to those who would enter",
            "control": f"controlled: {control_of(value)}" if isinstance(value, dict) else "without control",
            "move": f"moves {moving_of(value)}" if isinstance(value, dict) else "stands still",
            "one_way": "two-way" if ends else f"one-way, {value},",
            "slow": f"at {value} of the speed",
            "bar": "free" if ends else "barred",
            "strategy": f"to {', '.join(value) or 'any exit'}" if isinstance(value, tuple) else f"on the {value} way",
            "alarm": "alarmed",
            LIFT: " ".join(map(str, value[:2])) + "".join(f" for {stop}" for stop in value[2:])
            if isinstance(value, tuple)
            else "",
        }
        return done.get(self.kind, self.kind)

    def as_row(self) -> dict[str, Any]:
        """Return the change as a dictionary that can be written as JSON."""
        values = {key: list(value) if isinstance(value, tuple) else value for key, value in self.values.items()}
        return {"time": self.time, "kind": self.kind, "what": self.what, "values": values}

    @classmethod
    def from_row(cls, row: Any) -> "Change":
        """Return the change that `as_row` has written; ValueError if the row is not such a dictionary."""
        match row:
            case {"time": float(time), "kind": str(kind), "what": str(what), "values": dict(values)}:
                return cls(time, kind, what, values)
        raise ValueError(f"{row!r:.100} is not a change")


def changes_in_words(changes: Iterable[Change]) -> list[tuple[float, str]]:
    """Return times and words of changes, but for stops of lifts; what happens to several things at once is one."""
    alike: dict[tuple[float, str], list[str]] = {}
    for change in changes:
        if change.kind != LIFT:
            alike.setdefault((change.time, change.done), []).append(change.whom)
    return [(time, f"{', '.join(whom)} {done}") for (time, done), whom in alike.items()]


def control_of(value: Any) -> Control | None:
    """Return the control that a table describes, None if it describes none."""
    return _read(Control, value)


def moving_of(value: Any) -> Moving | None:
    """Return the motion of ground that a table describes, None if it describes none."""
    return _read(Moving, value)


def _read(kind: type[Described], value: Any) -> Described | None:
    try:
        return kind.model_validate(value)
    except ValidationError:
        return None


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and is_one_line(value)


def _is_plain(value: Any) -> bool:
    return _is_text(value) or (isinstance(value, int | float) and abs(value) <= sys.float_info.max)
