"""Types of the keys of case.toml, its tables, and faults that name a key and how to fix it."""

import re
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    InstanceOf,
    PlainSerializer,
    ValidationError,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from evac.base import defaults
from evac.base.distributions import Distribution, distribution_from
from evac.base.errors import EvacError, is_one_line
from evac.base.parameters import did_you_mean

Key = tuple[str | int, ...]  #: Path to a value of case.toml: names of tables, indexes of lists.
LONGEST_EXAMPLE = 80  #: Greatest number of characters of a value that is repeated as an example.
MOST_FAULTS = 1_000  #: Greatest number of faults that are collected for a case.

#: Name of a branch of a union, a number or a list, in the location of an error of pydantic.
BRANCH = re.compile(r"constrained-\w+|(tuple|function-\w+)\[.*\]")

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Switch = Annotated[bool, Field(strict=True)]

Coordinate = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-defaults.FARTHEST, le=defaults.FARTHEST)]
Point = tuple[Coordinate, Coordinate]


def _one_line(text: str) -> str:
    if not is_one_line(text):
        raise ValueError(f"must be one line without control characters, got {text!r}")
    return text


Title = Annotated[str, Field(max_length=defaults.LONGEST_NAME), AfterValidator(_one_line)]
Name = Annotated[str, Field(min_length=1, max_length=defaults.LONGEST_NAME), AfterValidator(_one_line)]


@dataclass(frozen=True)
class Factor:
    """A speed on stairs given as a factor of the person's speed on the flat."""

    factor: Distribution

    def to_value(self) -> dict[str, Any]:
        """Return the factor as written in case.toml."""
        return {"factor": self.factor.to_value()}


def _stair_speed(value: object) -> Distribution | Factor:
    if isinstance(value, Factor):
        return value
    if isinstance(value, dict) and "factor" in value:
        if len(value) > 1:
            raise ValueError("factor must be the only key; write { factor = { uniform = [0.4, 0.6] } }")
        return Factor(distribution_from(value["factor"], minimum=0.0, maximum=defaults.MOST_SPEED))
    return distribution_from(value, minimum=0.0, maximum=defaults.MOST_SPEED)


def _table_or_switch(value: object) -> object:
    if value is True:
        return {}
    if value is False or isinstance(value, dict):
        return value
    raise ValueError(f"must be a table of parameters, or false to switch it off, got {value!r}")


def _within(**bounds: float) -> BeforeValidator:
    """Return a validator that reads a distribution within bounds, see `distribution_from`."""
    return BeforeValidator(lambda value: distribution_from(value, **bounds))


_Written = PlainSerializer(lambda value: value.to_value())
Radius = Annotated[
    InstanceOf[Distribution], _within(minimum=defaults.LEAST_RADIUS, maximum=defaults.MOST_RADIUS), _Written
]
Height = Annotated[
    InstanceOf[Distribution], _within(minimum=defaults.LEAST_HEIGHT, maximum=defaults.MOST_HEIGHT), _Written
]
Mass = Annotated[InstanceOf[Distribution], _within(above=0.0, maximum=defaults.MOST_MASS), _Written]
Tau = Annotated[InstanceOf[Distribution], _within(above=0.0, maximum=defaults.MOST_TAU), _Written]
Speed = Annotated[InstanceOf[Distribution], _within(minimum=0.0, maximum=defaults.MOST_SPEED), _Written]
StairSpeed = Annotated[InstanceOf[Distribution] | InstanceOf[Factor], BeforeValidator(_stair_speed), _Written]
Parameters = Annotated[dict[str, Any] | Literal[False], BeforeValidator(_table_or_switch)]


def key(doc: str, unit: str = "", default: Any = ..., **bounds: Any) -> Any:
    """Return the pydantic field of a key with its meaning, SI unit, default and bounds."""
    return Field(default, description=doc, json_schema_extra={"unit": unit}, **bounds)


def wrong(key: str, message: str) -> PydanticCustomError:
    """Return an error at `key` of the table being validated."""
    return PydanticCustomError("case", "{text}", {"text": message, "key": key})


def is_multiple(value: float, unit: float) -> bool:
    """Return whether `value` is a whole number >= 1 of `unit`, up to rounding."""
    count = round(value / unit)
    return count >= 1 and abs(value - count * unit) <= 1e-9 * value


class Table(BaseModel):
    """A table of case.toml: frozen; unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def read(cls, given: Mapping[str, Any], error: type[EvacError], where: str) -> Self:
        """Return the table with keys given from Python, where arrays may stand for lists."""
        try:
            return cls.model_validate(with_own_classes(given))
        except ValidationError as failure:
            first = faults_of(failure, cls)[0]
            raise error(f"{where}{'.'.join(map(str, first.key))}: {first.text}") from None


#: Functions that convert a value of a subclass.
_OWN: dict[type, Callable[[Any], Any]] = {str: str.__str__, int: int.__int__, float: float.__float__}


def with_own_classes(value: Any) -> Any:
    """Return a copy in which arrays are lists, and subclasses of Python's own types, as in scripts, are these types."""
    if type(value) in (str, bool, int, float):
        return value
    if isinstance(value, Mapping):
        return {with_own_classes(key): with_own_classes(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [with_own_classes(item) for item in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    return next((own(value) for kind, own in _OWN.items() if isinstance(value, kind)), value)


@dataclass(frozen=True)
class Fault:
    """A fault: its key, its description with a fix, and whether it is a name that a plugin could provide."""

    key: Key
    text: str
    is_unknown_name: bool = False


def faults_of(error: ValidationError, root: type[Table]) -> list[Fault]:
    """Convert the errors of pydantic for a table to faults in the terms of case.toml."""
    details_of = _of_one_branch(error.errors(include_url=False, include_context=True))
    parents = {other["loc"][:length] for other in details_of for length in range(len(other["loc"]))}
    # A list is also reported as too short if items of it are not valid.
    own = [each for each in details_of[:MOST_FAULTS] if each["type"] != "too_short" or each["loc"] not in parents]
    return [_fault(details, root) for details in own]


def _of_one_branch(details_of: list[ErrorDetails]) -> list[ErrorDetails]:
    """Return errors without those of the branch of a union, a number or a list, for which a value is not meant."""
    found: dict[Key, list[ErrorDetails]] = {}
    for details in details_of:
        key = details["loc"]
        at = next((k for k, part in enumerate(key) if BRANCH.fullmatch(str(part))), len(key))
        of_another_kind = at == len(key) - 1 and details["type"].endswith("_type")
        details["loc"] = key[:at] + key[at + 1 :]
        others = found.setdefault(key[:at], [])
        if of_another_kind and others:
            continue
        if at < len(key) and others and others[0]["loc"] == key[:at] and others[0]["type"].endswith("_type"):
            others.clear()
        others.append(details)
    return [details for own in found.values() for details in own]


def _fault(details: ErrorDetails, root: type[Table]) -> Fault:
    key = details["loc"]
    kind = details["type"]
    got = reprlib.repr(details["input"])
    context = details.get("ctx", {})
    if kind == "extra_forbidden":
        return Fault(key, f"unknown key; {_known_key(key, root)}")
    if kind == "missing":
        return Fault(key, f"missing; give {_meaning(key, root)}")
    if kind == "case":
        return Fault((*key, context["key"]), context["text"])
    if kind == "value_error":
        return Fault(key, str(context["error"]))
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return Fault(key, f"must be a table, got {got}")
    if kind == "tuple_type":
        hint = ""
        if isinstance(details["input"], dict):
            hint = "; write its header in double brackets: [[...]]"
        elif isinstance(details["input"], str) and len(details["input"]) <= LONGEST_EXAMPLE:
            hint = f'; write {key[-1]} = ["{details["input"]}"]'
        return Fault(key, f"must be a list, got {got}{hint}")
    text = details["msg"].replace("Input should be", "must be").replace(" after validation", "")
    text = text.replace("Tuple should have", "must have").replace("String should have", "must have")
    if kind == "literal_error" and isinstance(details["input"], str):
        words = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        return Fault(key, f"{text}, got {got}; {did_you_mean(details['input'], words)}")
    return Fault(key, f"{text}, got {got}")


def _known_key(key: Key, root: type[Table]) -> str:
    """Return a hint for an unknown key: the closest key of the table, or another table with this key."""
    table = table_at(key[:-1], root)
    known = [field.alias or name for name, field in table.model_fields.items()] if table else []
    word = str(key[-1])
    for name in known:  # such as `file` for `mesh`, which is described as the file of the building
        if _meaning((*key[:-1], name), root).startswith(f"{word} "):
            return f"did you mean {name!r}?"
    for name, field in root.model_fields.items():
        other = table_of(field.annotation)
        if word not in known and other is not None and other is not table and word in other.model_fields:
            return f"it belongs to {name}: did you mean '{name}.{word}'?"
    return did_you_mean(word, known)


def _meaning(key: Key, root: type[Table]) -> str:
    table = table_at(key[:-1], root)
    field = table.model_fields.get(str(key[-1])) if table else None
    return (field.description if field else None) or "a value"


def table_at(key: Key, root: type[Table]) -> type[Table] | None:
    """Return the table that contains a key of a table."""
    table: type[Table] | None = root
    is_name = False  # of a table in a table of named tables, such as presets
    for step in key:
        if isinstance(step, str) and not is_name:
            field = table.model_fields.get(step) if table else None
            table = table_of(field.annotation) if field else None
            is_name = field is not None and get_origin(field.annotation) is dict
        else:
            is_name = False
    return table


def table_of(annotation: Any) -> type[Table] | None:
    """Return the table that is the type of a field or of the items of a list."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((inner for part in get_args(annotation) if (inner := table_of(part)) is not None), None)
