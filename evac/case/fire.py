"""The sections `[[conditions]]`, `[smoke]` and `[dose]` of case.toml: smoke, gases and heat, and what they do."""

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from evac.base.defaults import CONTRAST, FARTHEST
from evac.base.keys import Name, Real, Switch, Table, key, wrong
from evac.case.schema import LONGEST_RUN

#: Greatest value of a quantity of the air, whatever its unit.
MOST_VALUE = 1e6

Time = Annotated[Real, Field(ge=0, le=LONGEST_RUN)]
Value = Annotated[Real, Field(ge=-MOST_VALUE, le=MOST_VALUE)]
Shift = Annotated[Real, Field(ge=-FARTHEST, le=FARTHEST)]


class ConditionSettings(Table):
    """`[[conditions]]`: where the conditions of the air come from; where several tables apply, the last one does."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Any] = Field(init=False)

    source: str = key("name of the source: `prescribed`, `fds`, or that of a plugin")
    level: Name | tuple[Name, ...] | None = key(
        "name of the level or stair to which it applies, or a list of them; if not given, all", "", None
    )
    area: Name | None = key("name of the area to which it applies, instead of a level", "", None)
    file: str | None = key("file of the source, relative to case.toml", "", None, min_length=1)
    times: tuple[Time, ...] | None = key("times of the values, the first of them 0; if not given, constant", "s", None)
    values: dict[str, Value | tuple[Value, ...]] | None = key(
        "value of each quantity, or a list of its values at the times: extinction (1/m), co2, o2 (%), temperature (C), "
        "radiation (kW/m2), and in ppm co, hcn, no, no2, hcl, hbr, hf, so2, acrolein, formaldehyde",
        "",
        None,
    )
    above: Real = key("height above the floor from which the values apply", "m", 0.0, ge=0, le=100)
    below: Real | None = key("height above the floor up to which the values apply", "m", None, ge=0, le=100)
    start: Real = key("time of the source at the start of the run", "s", 0.0, ge=0, le=LONGEST_RUN)
    shift: tuple[Shift, Shift, Shift] = key(
        "coordinates of the building minus those of the source", "m", (0.0, 0.0, 0.0)
    )
    hold: Switch = key(
        "whether the last values hold after the last time; otherwise a run that lasts longer fails", "", False
    )

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the source."""
        return self.__pydantic_extra__ or {}

    @model_validator(mode="after")
    def _at_one_place(self) -> Self:
        if self.level is not None and self.area is not None:
            raise wrong("area", "give either level or area, not both; remove one")
        return self


class SmokeSettings(Table):
    """`[smoke]`: what people do in smoke; `[smoke.NAME]` has the parameters of a law."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, dict[str, Any]] = Field(init=False)

    law: str = key("name of the law of the speed in smoke; `none`: smoke does not reduce it", "", "fds_evac")
    irritants: Switch = key("whether irritant gases in the data reduce the speed further", "", True)
    sampling: Real = key(
        "time between two readings at people's heads, rounded to ticks; values are linear in between",
        "s",
        0.5,
        ge=0.001,
        le=60,
    )
    routes: Switch = key("whether routes are chosen for the reduced speeds in smoke", "", True)
    visibility: Real = key(
        "visibility below which people turn back if there is another way; 0: never", "m", 3.0, ge=0, le=100
    )
    contrast: Real = key(
        "visibility times extinction coefficient: 3 for reflecting objects, 8 for illuminated signs",
        "",
        CONTRAST,
        ge=1,
        le=20,
    )
    period: Real = key("time between two updates of routes, rounded to ticks", "s", 5.0, ge=0.1, le=600)
    noticed: Real = key(
        "change of the relative speed somewhere on a level after which its routes are updated",
        "",
        0.1,
        ge=0.001,
        le=1,
    )

    @property
    def tables(self) -> dict[str, dict[str, Any]]:
        """Parameters of each law that has a table of its own."""
        return self.__pydantic_extra__ or {}


class DoseSettings(Table):
    """`[dose]`: the dose of gases and heat that people take; without this table, none is computed."""

    form: Literal["fds", "sfpe", "iso"] = key(
        "fractional effective dose of gases after FDS, the SFPE Handbook (2016) or ISO 13571:2012", "", "fds"
    )
    activity: Literal["rest", "light", "heavy"] = key(
        "activity, which sets the breathing rate (fds, sfpe)", "", "light"
    )
    heat: Literal["clothed", "unclothed", "design", "none"] = key(
        "dose of heat: ISO 13571 clothed or unclothed, or the design equation of the SFPE Handbook", "", "clothed"
    )
    threshold: Real = key("dose of gases, or of heat, at which a median person is stopped", "", 1.0, gt=0, le=100)
    susceptibility: Literal["deterministic", "log-normal"] = key(
        "whether everybody has the same threshold, or thresholds are distributed", "", "deterministic"
    )
    sigma: Real = key("standard deviation of the logarithm of the thresholds", "", 0.94, gt=0, le=5)
    without: tuple[Name, ...] = key(
        "quantities that the dose needs and the data lack, which are declared to have no effect", "", ()
    )
