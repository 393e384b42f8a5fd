"""The tables of case.toml: every key with its type, unit, range, default and meaning."""

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from evac.base.defaults import COMFORT, LEAST_FLOOR, MOST_SPEED, ORDER, SPACING
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

#: Greatest number of steps in a tick, during which even an interrupt is not noticed.
MOST_STEPS = 100_000

#: Greatest number of people in a group, and in a case.
MOST_PEOPLE = 1_000_000

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

    @model_validator(mode="after")
    def _given_one_way(self) -> Self:
        if (self.mesh is None) == (self.plan is None):
            raise wrong("mesh", "give either the file of the building (mesh) or its plan (plan)")
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
        "relaxation time with which a person approaches the desired velocity",
        "s",
        Distribution("uniform", (0.1, 0.5)),
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
    limit_stair_speeds: Switch = key("whether speeds on stairs are limited to the speed on the flat", "", True)
    exits: tuple[str, ...] = key(
        "names of the exits that the group uses; empty: any. People pushed through another exit are out as well",
        "",
        (),
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
    exit: str | None = key(
        "name of the exit through which they enter; this, or `area` or `level` of the group", "", None
    )
    portal: str | None = key(
        "name of the portal or stair through which they enter the `level` of the group, as from a lift", "", None
    )

    @property
    def mean(self) -> int:
        """Mean number of people, rounded."""
        if self.times is not None:
            return len(self.times)
        return round((self.rate or 0.0) * ((self.to or 0.0) - (self.from_ or 0.0)))

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.times is None) == (self.rate is None):
            raise wrong("times", "give either the times, or rate, from and to")
        if self.times is not None and (self.from_ is not None or self.to is not None):
            raise wrong("from" if self.to is None else "to", "belongs to rate, not to times; remove it")
        if self.rate is not None and (self.from_ is None or self.to is None or self.from_ >= self.to):
            raise wrong("to", "give the times from and to of the rate, the earlier one first")
        if self.mean > MOST_PEOPLE:
            raise wrong("rate", f"gives {self.mean:,} people; reduce it to at most {MOST_PEOPLE:,}")
        return self


class GroupSettings(PeopleSettings):
    """`[[people]]`: a group: properties, number and start positions of its people."""

    name: Name = key("name of the group; the order of the tables has no influence")
    preset: str | None = key(
        "name of a preset of the case or a shipped one, for keys that this table does not have",
        "",
        None,
    )
    number: Whole | None = key("number of people; not needed with `positions`", "", None, ge=1, le=MOST_PEOPLE)
    area: str | None = key(
        "area of the building in which they start at random places; this, `level` or `positions`", "", None
    )
    positions: tuple[Point, ...] | None = key(
        "start position of each person [[x, y], ...]; this, `area` or `level`", "m", None, min_length=1
    )
    velocity: tuple[Velocity, ...] | None = key(
        "initial velocity of each person, with `positions` only; if not given, zero", "m/s", None
    )
    arrive: ArrivalSettings | None = key("when they enter, if they are not there from the start", "", None)
    leave: Switch = key("whether they leave; otherwise they stay where they are and are counted separately", "", True)
    z: Coordinate | None = key("height of the level of `positions`; this or `level`", "m", None)
    level: str | None = key(
        "name of the level of `positions`; without positions, name of the level on which they start at random places",
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
        if self.arrive is not None:
            self._check_arrival()
            return self
        if self.area is not None and self.positions is not None:
            raise wrong("area", "give either area or positions, not both; remove one")
        if self.area is None and self.positions is None and self.level is None:
            raise wrong("area", "give the start of the people: area and number, level and number, or positions")
        if self.positions is None:
            self._check_place()
        else:
            self._check_positions(len(self.positions))
        for quantity in ("radius", "height", "mass", "tau", "speed", "speed_up", "speed_down"):
            given = getattr(self, quantity)
            values = given.factor if isinstance(given, Factor) else given
            if values.kind == "list" and len(values.numbers) != self.count:
                raise wrong(quantity, f"{len(values.numbers)} values for {self.count} people; give one for each person")
        return self

    def _check_arrival(self) -> None:
        assert self.arrive is not None
        given = [name for name in ("area", "level") if getattr(self, name) is not None]
        if len(given) + (self.arrive.exit is not None) != 1:
            raise wrong("arrive", "give one place at which they enter: area, level, or arrive.exit")
        if self.arrive.portal is not None and self.level is None:
            raise wrong("level", "missing; name the level that people enter through arrive.portal")
        for other in ("number", "positions", "velocity", "z"):
            if getattr(self, other) is not None:
                raise wrong(other, "cannot be used with arrive, whose times or rate set the number; remove it")

    def _check_place(self) -> None:
        place = "area" if self.area is not None else "level"
        if self.number is None:
            raise wrong("number", f"missing; give the number of people who start in the {place}")
        for other in ("velocity", "z", *(("level",) if place == "area" else ())):
            if getattr(self, other) is not None:
                raise wrong(other, f"can be used only with positions, not with {place} and number; remove it")

    def _check_positions(self, count: int) -> None:
        if self.number not in (None, count):
            raise wrong("number", f"{self.number} people but {count} positions; remove number or correct it")
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
    replay: Switch = key("whether replay.html is written, which plays the run in a browser", "", True)
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
    aset: dict[str, Annotated[Real, Field(ge=0.0, le=1e6)]] = key(
        "available safe egress time of levels, by name, for comparison with the times at which they were left", "s", {}
    )


class PluginSettings(Table):
    """`[plugins]`: plugin files in addition to the installed plugins."""

    files: tuple[str, ...] = key("Python files, relative to case.toml", "", ())
