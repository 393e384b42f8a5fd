"""Types of the keys of case.toml: numbers, distributions, tables; and errors that name a key."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, InstanceOf, PlainSerializer
from pydantic_core import PydanticCustomError

from evac.base.defaults import FARTHEST, LEAST_RADIUS, LONGEST_NAME, MOST_MASS, MOST_RADIUS, MOST_SPEED, MOST_TAU
from evac.base.distributions import Distribution, distribution_from
from evac.base.errors import is_one_line

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Switch = Annotated[bool, Field(strict=True)]

Coordinate = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-FARTHEST, le=FARTHEST)]
Point = tuple[Coordinate, Coordinate]


def _one_line(text: str) -> str:
    if not is_one_line(text):
        raise ValueError(f"must be one line without control characters, got {text!r}")
    return text


Title = Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(_one_line)]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_one_line)]


@dataclass(frozen=True)
class Factor:
    """A speed on stairs given as a factor of the person's speed on the flat."""

    factor: Distribution


def _stair_speed(value: object) -> Distribution | Factor:
    if isinstance(value, Factor):
        return value
    if isinstance(value, dict) and "factor" in value:
        if len(value) > 1:
            raise ValueError("factor must be the only key; write { factor = { uniform = [0.4, 0.6] } }")
        return Factor(distribution_from(value["factor"], minimum=0.0, maximum=MOST_SPEED))
    return distribution_from(value, minimum=0.0, maximum=MOST_SPEED)


def _as_written(value: Distribution | Factor) -> Any:
    return {"factor": value.factor.to_value()} if isinstance(value, Factor) else value.to_value()


def _table_or_switch(value: object) -> object:
    if value is True:
        return {}
    if value is False or isinstance(value, dict):
        return value
    raise ValueError(f"must be a table of parameters, or false to switch it off, got {value!r}")


def _within(**bounds: float) -> BeforeValidator:
    """Return a validator that reads a distribution within bounds, see `distribution_from`."""
    return BeforeValidator(lambda value: distribution_from(value, **bounds))


Radius = Annotated[
    InstanceOf[Distribution], _within(minimum=LEAST_RADIUS, maximum=MOST_RADIUS), PlainSerializer(_as_written)
]
Mass = Annotated[InstanceOf[Distribution], _within(above=0.0, maximum=MOST_MASS), PlainSerializer(_as_written)]
Tau = Annotated[InstanceOf[Distribution], _within(above=0.0, maximum=MOST_TAU), PlainSerializer(_as_written)]
Speed = Annotated[InstanceOf[Distribution], _within(minimum=0.0, maximum=MOST_SPEED), PlainSerializer(_as_written)]
StairSpeed = Annotated[
    InstanceOf[Distribution] | InstanceOf[Factor], BeforeValidator(_stair_speed), PlainSerializer(_as_written)
]
Parameters = Annotated[dict[str, Any] | Literal[False], BeforeValidator(_table_or_switch)]


def key(doc: str, unit: str = "", default: Any = ..., **bounds: Any) -> Any:
    """Return the pydantic field of a key with its meaning, SI unit, default and bounds."""
    return Field(default, description=doc, json_schema_extra={"unit": unit}, **bounds)


def wrong(key: str, message: str) -> PydanticCustomError:
    """Return an error at `key` of the section being validated."""
    return PydanticCustomError("case", "{text}", {"text": message, "key": key})


def is_multiple(value: float, unit: float) -> bool:
    """Return whether `value` is a whole number >= 1 of `unit`, up to rounding."""
    count = round(value / unit)
    return count >= 1 and abs(value - count * unit) <= 1e-9 * value


class Section(BaseModel):
    """A table of case.toml: frozen; unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")
