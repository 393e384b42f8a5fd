"""The tables of case.toml: every key with its type, unit, range, default and meaning."""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from evac.base.change import REMEDIES
from evac.base.defaults import COMFORT, CONTRAST, FARTHEST, LEAST_FLOOR, MOST_SPEED, ORDER, SIGN_RANGE, SPACING
from evac.base.distributions import Distribution
from evac.base.keys import (
    Coordinate,
    Factor,
    Height,
    Mass,
    Name,
    Point,
    Radius,
    Real,
    Speed,
    StairSpeed,
    Switch,
    Table,
    Tau,
    Whole,
    is_multiple,
    key,
    wrong,
)
from evac.building.options import BuildingOptions, check_level
from evac.directions.routes import Strategy

MOST_STEPS = 100_000  #: Greatest number of steps in a tick, during which even an interrupt is not noticed.
MOST_PEOPLE = 1_000_000  #: Greatest number of people in a group, and in a case.
MOST_DENSITY = 20.0  #: Greatest density of people [1/m2]; they cannot stand closer.
MOST_VALUE = 1e6  #: Greatest value of a quantity of the air, whatever its unit.

#: Greatest simulated time of a run [s], four months, and number of states that it records.
LONGEST_RUN = 1e7
MOST_STATES = 10_000_000


Velocity = tuple[
    Annotated[Real, Field(ge=-MOST_SPEED, le=MOST_SPEED)], Annotated[Real, Field(ge=-MOST_SPEED, le=MOST_SPEED)]
]


class BuildingSource(Table):
    """Where the building is."""

    mesh: str | None = key("file of the building, relative to case.toml; this or `plan`", "", None, min_length=1)
    plan: dict[str, Any] | None = key("the building as a plan, with the keys of a plan file", "", None)

    @field_validator("plan", mode="before")
    @classmethod
    def _names_no_file(cls, plan: Any) -> Any:
        if isinstance(plan, str):
            raise ValueError(f"must be a table; a file is named by mesh = {plan!r}")
        return plan

    @model_validator(mode="after")
    def _given_one_way(self) -> Self:
        if (self.mesh is None) == (self.plan is None):
            remedy = "to set keys of a plan file in a study, write its tables into the case as [building.plan]"
            raise wrong("mesh", f"give either the file of the building (mesh) or its plan (plan); {remedy}")
        return self


class BuildingSettings(BuildingOptions, BuildingSource):
    """`[building]`: the file of the building, how it is read, and additions to it."""


class QuickestSettings(Table):
    """`[directions.quickest]`: how the directions of the strategy "quickest" follow the crowd."""

    period: Real = key("time between two updates, rounded to ticks", "s", 2.0, ge=0.1, le=60)
    width: Real = key(
        "standard deviation of the kernel with which each person adds to the density; 0.5 to 1 m resolves the queue at "
        "a door",
        "m",
        0.6,
        ge=0.1,
        le=5,
    )
    memory: Real = key("time over which densities and queues are averaged", "s", 4.0, ge=0, le=60)
    hesitation: Real = key(
        "time that the way to another exit must save before people change to it, at least 5 % of the remaining time",
        "s",
        2.0,
        ge=0,
        le=600,
    )
    floor: Real = key(
        "least relative speed; otherwise the speed falls with the density as in Weidmann, Transporttechnik der "
        "Fussgaenger (1993), and above 1.75 people per m2 such that the flow is constant",
        "",
        0.05,
        ge=LEAST_FLOOR,
        le=1,
    )


class DirectionSettings(Table):
    """`[directions]`: how travel times and directions are computed."""

    spacing: Real = key("distance of the grid's nodes", "m", SPACING, ge=0.001, le=10)
    clearance: Real | None = key(
        "distance kept from walls where there is room; if not given, the greatest body radius, at most twice the mean",
        "m",
        None,
        ge=0,
        le=5,
    )
    stairs_up: Real | None = key(
        "reference speed up stairs over that on the flat; if not given, the people's mean", "", None, ge=0.001, le=1000
    )
    stairs_down: Real | None = key(
        "reference speed down stairs over that on the flat; if not given, the people's mean",
        "",
        None,
        ge=0.001,
        le=1000,
    )
    comfort: Real = key('weight of the time on stairs for the strategy "comfortable"', "", COMFORT, ge=1, le=1000)
    order: Literal[1, 2] = key("order of the fast marching scheme", "", ORDER)
    costs: dict[str, Annotated[Real, Field(ge=0.0, le=1e6)]] = key(
        "times that ways to exits and places are longer than they are walked, by name, such as waiting outside", "s", {}
    )
    quickest: QuickestSettings = key('how the strategy "quickest" follows the crowd', "", QuickestSettings())


class PeopleSettings(Table):
    """`[presets.NAME]`: properties of people; each quantity is a number or a distribution."""

    radius: Radius = key("body radius, at least 0.01 m", "m", Distribution("uniform", (0.2, 0.25)))
    height: Height = key(
        "body height, for the replay, pictures in three dimensions and VTK; the default is from the 5th percentile of "
        "women to the 95th of men after DIN 33402-2:2005",
        "m",
        Distribution("uniform", (1.535, 1.855)),
    )
    mass: Mass = key("mass", "kg", Distribution("uniform", (60.0, 100.0)))
    tau: Tau = key(
        "relaxation time with which a person approaches the desired velocity", "s", Distribution("uniform", (0.1, 0.5))
    )
    speed: Speed = key("desired speed on the flat", "m/s", Distribution("uniform", (1.2, 2.0)))
    speed_up: StairSpeed = key(
        "desired speed up stairs, along the slope; { factor = ... } multiplies the person's speed on the flat",
        "m/s",
        Distribution("uniform", (0.5, 1.0)),
    )
    speed_down: StairSpeed = key(
        "desired speed down stairs, along the slope; { factor = ... } multiplies the person's speed on the flat",
        "m/s",
        Distribution("uniform", (0.5, 1.0)),
    )
    turns: Switch = key(
        "whether people turn their shoulders, so that a behaviour such as `walking` may give them a narrower body; "
        "false for wheelchairs, for example",
        "",
        True,
    )
    steepest: Real | None = key(
        "steepest stair or ramp that their routes use, as rise over run: 0 excludes all, 0.0834 those above 1:12; if "
        "not given, none is excluded",
        "",
        None,
        ge=0,
        le=10,
    )
    lifts: Literal["", "weighed", "preferred"] | None = key(
        "whether their routes lead by lift: `weighed`, where the expected wait and the ride take less time, "
        "or `preferred`, with times on stairs ten times as long; empty: never. If not given, those of groups with "
        "`steepest` do, as `weighed`, and others never",
        "",
        None,
    )
    limit_stair_speeds: Switch = key("whether speeds on stairs are limited to the speed on the flat", "", True)
    exits: tuple[str, ...] = key(
        "names of the exits that the group uses; empty: any. People pushed through another exit are out as well", "", ()
    )
    assembly: tuple[str, ...] = key(
        "names of the assembly areas ([[place]]) to which the group goes, instead of to exits; empty: none", "", ()
    )
    strategy: Strategy = key("quantity that their route to an exit minimises", "", "fastest")
    behaviours: dict[str, dict[str, Any]] = key("settings of this group for behaviours in use, by their name", "", {})


class ArrivalSettings(Table):
    """`arrive` of a group: when its people come, at times or at a rate."""

    times: tuple[Annotated[Real, Field(ge=0, le=LONGEST_RUN)], ...] | None = key(
        "time at which each person enters; this or `rate`", "s", None, min_length=1, max_length=MOST_PEOPLE
    )
    rate: Annotated[Real, Field(gt=0, le=MOST_PEOPLE)] | None = key(
        "mean number of people per second, who enter in a Poisson process", "1/s", None
    )
    from_: Real | None = key("time from which people enter at the rate", "s", None, ge=0, le=LONGEST_RUN, alias="from")
    to: Real | None = key("time until which they do", "s", None, ge=0, le=LONGEST_RUN)
    reserve: Whole | None = key(
        "greatest number of people whom a program or a behaviour adds; this instead of times or rate",
        "",
        None,
        ge=1,
        le=MOST_PEOPLE,
    )
    exit: str | None = key(
        "name of the exit through which they enter; this, or `area` or `level` of the group", "", None
    )
    portal: str | None = key(
        "name of the portal or stair through which they enter the `level` of the group, as from a lift", "", None
    )

    @property
    def mean(self) -> int:
        """Mean number of people, rounded."""
        if self.times is not None or self.reserve is not None:
            return len(self.times or ()) or self.reserve or 0
        return round((self.rate or 0.0) * ((self.to or 0.0) - (self.from_ or 0.0)))

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(given is not None for given in (self.times, self.rate, self.reserve)) != 1:
            raise wrong("times", "give either the times, or rate, from and to, or reserve")
        if self.rate is None and (self.from_ is not None or self.to is not None):
            raise wrong("from" if self.to is None else "to", "belongs to rate; remove it")
        if self.rate is not None and (self.from_ is None or self.to is None or self.from_ >= self.to):
            raise wrong("to", "give the times from and to of the rate, the earlier one first")
        if self.mean > MOST_PEOPLE:
            raise wrong("rate", f"gives {self.mean:,} people; reduce it to at most {MOST_PEOPLE:,}")
        return self


#: Keys by which people start, the first that is given, and the others that each may have beside it.
STARTS: Mapping[str, tuple[str, ...]] = {
    "arrive": ("area", "level"),
    "positions": ("number", "level", "velocity", "z"),
    "area": ("number", "density"),
    "use": ("number", "density"),
    "level": ("number", "density"),
}
START_KEYS = ("number", "density", "velocity", "z")


class GroupSettings(PeopleSettings):
    """`[[people]]`: a group: properties, number and start positions of its people."""

    name: Name = key("name of the group; the order of the tables has no influence")
    preset: str | None = key(
        "name of a preset of the case or a shipped one, for keys that this table does not have", "", None
    )
    number: Whole | None = key("number of people; not needed with `positions`", "", None, ge=1, le=MOST_PEOPLE)
    density: Annotated[Real, Field(gt=0, le=MOST_DENSITY)] | None = key(
        "instead of `number`, people per square metre of their `area`, `level` or rooms of a `use`", "1/m2", None
    )
    area: str | None = key(
        "area of the building in which they start at random places; this, `level`, `use` or `positions`", "", None
    )
    use: str | None = key(
        "use of the rooms in which they start. Without `number` and `density`, as many start in each room, and in an "
        "`area`, as the plan states, or else as fit its use by the table of loads",
        "",
        None,
        min_length=1,
    )
    positions: tuple[Point, ...] | None = key(
        "start position of each person [[x, y], ...]; this, `area`, `level` or `use`", "m", None, min_length=1
    )
    velocity: tuple[Velocity, ...] | None = key(
        "initial velocity of each person, with `positions` only; if not given, zero", "m/s", None
    )
    arrive: ArrivalSettings | None = key("when they enter, if they are not there from the start", "", None)
    leave: Switch = key("whether they leave; otherwise they stay where they are and are counted separately", "", True)
    z: Coordinate | None = key("height of the level of `positions`; this or `level`", "m", None)
    level: str | None = key(
        "name of the level of `positions`, or of the level, stair or shaft on which they start at random places",
        "",
        None,
    )

    @property
    def count(self) -> int:
        """Number of people in the group; of those who come at a rate, the mean number."""
        if self.arrive is not None:
            return self.arrive.mean
        return len(self.positions) if self.positions is not None else self.number or 0

    @model_validator(mode="after")
    def _placed_one_way(self) -> Self:
        way = next((name for name in STARTS if getattr(self, name) is not None), None)
        if way is None:
            raise wrong("area", "give the start of the people: area, level or use with their number, or positions")
        for other in (*STARTS, *START_KEYS):
            if other not in (way, *STARTS[way]) and getattr(self, other) is not None:
                raise wrong(other, f"cannot be used with {way}; remove one of them")
        if self.arrive is not None:
            self._check_arrival(self.arrive)
            return self
        if self.positions is not None:
            self._check_positions(len(self.positions))
        elif self.number is not None and self.density is not None:
            raise wrong("density", "give either number or density, not both; remove one")
        elif way == "level" and self.number is None and self.density is None:
            raise wrong("number", "missing; give the number of people who start on the level, or their density")
        for quantity in ("radius", "height", "mass", "tau", "speed", "speed_up", "speed_down"):
            given = getattr(self, quantity)
            values = given.factor if isinstance(given, Factor) else given
            if values.kind == "list" and len(values.numbers) != self.count:
                raise wrong(quantity, f"{len(values.numbers)} values for {self.count} people; give one for each person")
        return self

    def _check_arrival(self, arrive: ArrivalSettings) -> None:
        if sum(given is not None for given in (self.area, self.level, arrive.exit)) != 1:
            raise wrong("arrive", "give one place at which they enter: area, level, or arrive.exit")
        if arrive.portal is not None and self.level is None:
            raise wrong("level", "missing; name the level that people enter through arrive.portal")

    def _check_positions(self, count: int) -> None:
        if self.number not in (None, count):
            remedy = "remove number, or give an area or a level instead of positions"
            raise wrong("number", f"{self.number} people but {count} positions; {remedy}")
        check_level("the level of the positions", self.level, self.z)
        if self.velocity is not None and len(self.velocity) != count:
            raise wrong("velocity", f"{len(self.velocity)} velocities for {count} positions; give one per position")


class ContactSettings(Table):
    """`[contact]`: the model in use, and in `[contact.NAME]` the parameters of any model."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, dict[str, Any]] = Field(init=False)

    model: str = key("name of the contact model in use; `evac plugins` lists them")

    @property
    def tables(self) -> dict[str, dict[str, Any]]:
        """Parameters of each model that has a table of its own."""
        return self.__pydantic_extra__ or {}


class SimulationSettings(Table):
    """`[simulation]`: time, seed and scheme."""

    step: Real = key("time step h of the physics", "s", 0.01, ge=1e-9, le=10)
    tick: Real = key("time between two decisions of the behaviours, a multiple of `step`", "s", 0.1, ge=1e-9, le=3600)
    duration: Real = key(
        "greatest simulated time, after which the run ends; rounded to whole steps", "s", 300.0, gt=0, le=LONGEST_RUN
    )
    seed: Whole = key("seed of all random numbers", "", 1, ge=0, le=2**63 - 1)
    population_seed: Whole | None = key(
        "seed of the properties of people (radius, height, mass, tau, speeds): runs with different `seed` then place "
        "the same people elsewhere; if not given, `seed`",
        "",
        None,
        ge=0,
        le=2**63 - 1,
    )
    driving: Literal["exponential", "explicit"] = key(
        "update of the driving force (eq. 33): exact exponential, or the paper's explicit Euler", "", "exponential"
    )
    no_progress: Annotated[float, Field(strict=True)] = key(
        "the run ends when nobody has left or approached an exit for this time; inf: never", "s", 60.0, gt=0
    )

    @property
    def is_explicit(self) -> bool:
        """Whether the drive is updated by explicit Euler."""
        return self.driving == "explicit"

    @property
    def steps_per_tick(self) -> int:
        """Number of steps from one decision of the behaviours to the next."""
        return round(self.tick / self.step)

    @property
    def last_step(self) -> int:
        """Number of steps in the whole duration."""
        return round(self.duration / self.step)

    @model_validator(mode="after")
    def _tick_of_steps(self) -> Self:
        if not is_multiple(self.tick, self.step):
            below = max(1, int(self.tick / self.step))
            raise wrong(
                "tick",
                f"{self.tick:g} s is not a multiple of simulation.step {self.step:g} s; use "
                f"tick = {below * self.step:.6g} or {(below + 1) * self.step:.6g}, "
                f"or step = {self.tick / (below + 1):.6g} or {self.tick / below:.6g}",
            )
        if self.tick > MOST_STEPS * self.step:
            raise wrong(
                "step",
                f"{self.step:g} s gives {self.tick / self.step:.3g} steps in a tick of {self.tick:g} s, more than "
                f"{MOST_STEPS:,}; use a longer step or a shorter tick",
            )
        if self.last_step < 1:
            raise wrong(
                "duration",
                f"{self.duration:g} s is less than half of simulation.step {self.step:g} s, so that no step is made; "
                "use a longer duration",
            )
        return self


class OutputSettings(Table):
    """`[output]`: files in the result folder in addition to summary.json."""

    every: Real = key(
        "time between two recorded states, a multiple of `simulation.tick`", "s", 0.5, gt=0, le=LONGEST_RUN
    )
    tables: Switch = key("whether people.csv, egress.csv, flows.csv and crossings.csv are written", "", True)
    picture: Switch = key("whether the egress curve is drawn to egress.png", "", True)
    replay: Switch = key(
        "whether replay.html is written, which plays the run in a browser; without `trajectory` there is none", "", True
    )
    trajectory: Switch = key(
        "whether the motion of people is recorded in trajectory.evac, from which other outputs can be made later",
        "",
        True,
    )
    animation: Switch = key("whether VTK files for ParaView are written; needs `trajectory`", "", False)

    @model_validator(mode="after")
    def _animation_of_trajectory(self) -> Self:
        if self.animation and not self.trajectory:
            raise wrong("animation", "needs the trajectory; set output.trajectory = true, or animation = false")
        return self


class ReportSettings(Table):
    """`[report]`: what the report of the run says that the run does not know."""

    project: str = key("name of the project", "", "")
    author: str = key("author of the analysis", "", "")
    date: str = key("date of the report", "", "")


class PluginSettings(Table):
    """`[plugins]`: plugin files in addition to the installed plugins."""

    files: tuple[str, ...] = key("Python files, relative to case.toml", "", ())


class PlaceSettings(Table):
    """`[[place]]`: an area with a task in the evacuation."""

    name: Name = key("name of the place")
    kind: Literal["refuge", "assembly", "sign", "fire"] = key(
        "refuge: people whose group has `steepest` or `turns = false`, and who have no way out that they fit through, "
        "go there and stay; assembly: destination of groups that name it in `assembly`, or that an event sends there; "
        "sign: shows people the way to an exit, if a behaviour such as `familiarity` follows signs; fire: where it "
        "burns, as pictures show it"
    )
    area: str | None = key("name of the area of the building, for a refuge or assembly area", "", None)
    capacity: Whole | None = key(
        "greatest number of people; if not given, there is no limit", "", None, ge=1, le=MOST_PEOPLE
    )
    position: Point | None = key("position of a sign [x, y], about 0.1 m in front of its wall, or of a fire", "m", None)
    z: Coordinate | None = key("height of the floor under a sign or a fire; this or `level`", "m", None)
    level: str | None = key("name of the level of a sign or a fire; this or `z`", "", None)
    exit: str | None = key("name of the exit that a sign shows", "", None)
    range: Annotated[Real, Field(gt=0, le=1000)] | None = key(
        f"distance from which a sign is seen; if not given, {SIGN_RANGE:g} m. In EN 1838 it is 200 times the height "
        "of internally lit signs, and 100 times that of others",
        "m",
        None,
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        kinds = {"sign": ("position", "exit", "level", "z", "range"), "fire": ("position", "level", "z")}
        known = kinds.get(self.kind, ("area", "capacity"))
        for name in ("position", "exit", "area"):
            if name in known and getattr(self, name) is None:
                raise wrong(name, f"missing; a place of kind {self.kind} needs it")
        for name in ("area", "capacity", *kinds["sign"]):
            if name not in known and getattr(self, name) is not None:
                raise wrong(name, f"a place of kind {self.kind} has no {name}; remove it")
        if self.kind in kinds:
            check_level(f"the level of the {self.kind}", self.level, self.z)
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


CONDITIONS = ("event", "out", "count", "at_most", "density", "smoke")  #: The conditions of which `when` has one.
IN_AREA = ("count", "at_most", "density", "smoke")  #: Those of them that are about an area.


def _or_as_given(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    """Return a value of a wrong type as it is: a check says what the kind of the event needs."""
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
    smoke: Annotated[Real, Field(gt=0, le=MOST_VALUE)] | None = key(
        "at least this extinction coefficient at the heads of people in `area`", "1/m", None
    )
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


if TYPE_CHECKING:
    KindOfChange = str
else:
    KindOfChange = Literal[tuple(REMEDIES)]


class EventSettings(Table):
    """`[[event]]`: a change during the run, at a time or when something happens."""

    name: Name | None = key("name by which other events refer to it", "", None)
    time: Annotated[Real, Field(ge=0, le=LONGEST_RUN)] | None = key("time of the event; this or `when`", "s", None)
    when: WhenSettings | None = key("what makes it happen, once; this or `time`", "", None)
    kind: KindOfChange = key(
        "`open` or `close` an exit, portal, stair or door, make it `one_way`, or `control` it; `move` an escalator; "
        "`slow` people in an area or on a level, `bar` it, or let people only leave it (`no_entry`); change the "
        "`strategy` of a group; sound an `alarm`"
    )
    target: str = key(
        "name of what changes: exit, portal, stair, door, area, level or group; of an alarm, an area, a level or a "
        "group, or everybody if not given",
        "",
        "",
    )
    value: Annotated[Switch | Real | str | tuple[str, ...] | dict[str, Any] | None, WrapValidator(_or_as_given)] = key(
        '`close`: "bodies" if ways still lead through, so that people wait before it; of a stair "leave", the default, '
        'if those on it go on and it closes behind the last of them, or "all" if it shuts them in; `no_entry`: false '
        "to end it; `control`: a table with the keys of `[building.controls]`, or false to end it; "
        "`move`: a table with the keys of `[building.moving]`, or false to stop it; "
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


class PhaseSettings(Table):
    """`[[phase]]`: people who start in some places respond to an alarm of their own."""

    name: Name = key("name of the phase, by which other phases and events refer to it")
    of: tuple[str, ...] = key("names of its levels, stairs, shafts, areas or groups", "", min_length=1)
    delay: Real = key("time from the cue to the alarm of the phase", "s", 0.0, ge=0, le=LONGEST_RUN)
    cue: Name | None = key("name of an event or another phase; if not given, the start of the run", "", None)

    @property
    def alarms(self) -> tuple[EventSettings, ...]:
        """Its alarms, one for each place; the first has the name of the phase."""
        when = None if self.cue is None else WhenSettings(event=self.cue, after=self.delay)
        time, names = (self.delay if when is None else None), (self.name, *(None for _ in self.of[1:]))
        return tuple(
            EventSettings(name=name, time=time, when=when, kind="alarm", target=place)
            for name, place in zip(names, self.of, strict=True)
        )


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
        "radiation (kW/m2), layer (m), and in ppm co, hcn, no, no2, hcl, hbr, hf, so2, acrolein, formaldehyde",
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
    temperature: Real = key(
        "temperature above which people turn back if there is another way", "C", 60.0, ge=0, le=5000
    )
    radiation: Real = key(
        "radiative flux above which people turn back if there is another way", "kW/m2", 2.5, gt=0, le=10000
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
        "change of the relative speed somewhere on a level after which its routes are updated", "", 0.1, ge=0.001, le=1
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


class CriteriaSettings(Table):
    """Criteria of the time that is available; the first one that is met ends it."""

    available: Annotated[Real, Field(ge=0, le=LONGEST_RUN)] | None = key("available time, given by hand", "s", None)
    visibility: Annotated[Real, Field(ge=0, le=1000)] | None = key("visibility at heads that is too short", "m", None)
    temperature: Annotated[Real, Field(ge=0, le=1000)] | None = key("temperature at heads that is too high", "C", None)
    fed: Annotated[Real, Field(gt=0, le=100)] | None = key(
        "dose of gases or heat that is too great: of those who stay from the start, and the own one of each person",
        "",
        None,
    )
    fic: Annotated[Real, Field(gt=0, le=100)] | None = key(
        "fractional concentration of irritants that is too high", "", None
    )
    layer: Annotated[Real, Field(ge=0, le=100)] | None = key(
        "height of the layer of smoke above the floor that is too low", "m", None
    )
    share: Annotated[Real, Field(ge=0, le=1)] | None = key(
        "share of the floor on which a criterion must be met; if not given, it is enough anywhere", "", None
    )


class SafetySettings(CriteriaSettings):
    """`[safety]`: criteria of all compartments; without `[[compartment]]`, each storey and each stair is one."""

    factor: Real = key(
        "safety factor: the available time should be this many times the required one", "", 1.0, ge=1, le=100
    )
    percentile: Real = key("percentile of the required times of the runs of a study", "%", 95.0, gt=0, lt=100)


class CompartmentSettings(CriteriaSettings):
    """`[[compartment]]`: a part of the building that must be left in time; other criteria than those of `[safety]`."""

    name: Name = key("name of the compartment")
    of: tuple[Name, ...] = key("its levels, stairs and areas; if not given, that of its name", "", ())
    without: tuple[Name, ...] = key("areas without criteria, such as that in which the fire starts", "", ())
    everybody: Switch = key(
        "whether all who walk in it belong to it, not only those who start in it; on a stair all do", "", False
    )


DESCRIPTION = ("about", "source")  #: Keys of a shipped preset that describe it, besides those of `PeopleSettings`.


@cache
def shipped_presets() -> dict[str, dict[str, Any]]:
    """Return the shipped presets by name, with their `DESCRIPTION`."""
    return tomllib.loads(files("evac.case").joinpath("presets.toml").read_text(encoding="utf-8"))


def with_presets(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a case whose groups have the keys of their presets.

    Presets of the case go before shipped ones of the same name, and keys of a group before those of its preset.
    """
    own, groups = content.get("presets", {}), content.get("people")
    if not isinstance(own, dict) or not isinstance(groups, list):
        return content
    filled = list(groups)
    for index, group in enumerate(groups):
        name = group.get("preset") if isinstance(group, dict) else None
        preset = (own if name in own else shipped_presets()).get(name) if isinstance(name, str) else None
        if isinstance(preset, dict):
            without = () if name in own else DESCRIPTION
            filled[index] = {key: value for key, value in preset.items() if key not in without} | group
    return {**content, "people": filled}
