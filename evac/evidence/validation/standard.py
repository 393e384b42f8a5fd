"""The standard tests: their names in RiMEA, IMO, NIST and ISO, what they measure, and why some are not run."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from evac.base.errors import ScenarioError, SimulationError
from evac.base.parameters import did_you_mean
from evac.evidence.validation import alone, choices, crowds
from evac.evidence.validation.trial import Check, Trial

#: The documents, the sources in which they were read since not all originals were available, and their tests.
STANDARDS = {
    "RiMEA": "RiMEA guideline 4.1.1 (2025), annex 1; read: drawings of 3.0 in jpscore, 4.1.1 in quotations",
    "IMO": "IMO MSC.1/Circ.1533 (2016), annex 3, appendix 2; read in FDS+Evac's guide and community documents",
    "NIST": "NIST TN 1822 (Ronchi et al. 2013); read in a port by the community, whose dimensions may differ",
    "ISO": "ISO 20414:2020, verification tests; read in community documents, whose dimensions may differ",
}

PASSED, FAILED, NOT_YET, NOT_APPLICABLE = "passed", "FAILED", "not yet", "not applicable"


@dataclass(frozen=True)
class StandardTest:
    """A test of one or several standards.

    Attributes
    ----------
    names : tuple of str
        Such as RiMEA-1; the first one names its folder.
    title : str
    measure : callable or None
        Yields the checks of a trial; None if the test is not run.
    runs : int
        Number of seeds; 1 where nothing is drawn.
    why : str
        Why it is not run, which begins with `NOT_YET` or `NOT_APPLICABLE`.
    by_design : str
        Why the default movement fails it; empty if it should pass.
    """

    names: tuple[str, ...]
    title: str
    measure: Callable[[Trial], Iterable[Check]] | None = None
    runs: int = 1
    why: str = ""
    by_design: str = ""

    @property
    def name(self) -> str:
        """The first name."""
        return self.names[0]


@dataclass(frozen=True)
class Result:
    """What came of a test: its checks, or the error that ended it."""

    test: StandardTest
    checks: tuple[Check, ...] = ()
    error: str = ""

    @property
    def verdict(self) -> str:
        """Whether the test is passed: if all its checks are."""
        if self.test.measure is None:
            return NOT_YET if self.test.why.startswith(NOT_YET) else NOT_APPLICABLE
        return PASSED if not self.error and all(check.is_passed for check in self.checks) else FAILED


def carry_out(test: StandardTest, trial: Trial, seed: int) -> Result:
    """Carry out a test; its runs have the seeds from `seed` on, and folders in the folder of the trial."""
    if test.measure is None:
        return Result(test)
    own = replace(trial, folder=trial.folder / test.name, seeds=tuple(range(seed, seed + test.runs)))
    try:
        return Result(test, tuple(test.measure(own)))
    except SimulationError as error:
        return Result(test, error=str(error))


def find_tests(names: Iterable[str]) -> list[StandardTest]:
    """Return the tests with given names, each once: of a test, of a standard, or "all".

    Raises
    ------
    ScenarioError
        There is no such test.
    """
    found: list[StandardTest] = []
    known = {name.lower(): [test] for test in TESTS for name in test.names}
    known |= {standard.lower(): of_standard(standard) for standard in STANDARDS} | {"all": list(TESTS)}
    for name in names:
        if name.lower() not in known:
            standard = next((one for one in STANDARDS if name.lower().startswith(one.lower())), "")
            words = [one for test in of_standard(standard) for one in test.names] if standard else ["all", *STANDARDS]
            near = did_you_mean(f"{standard}{name[len(standard) :]}", words)
            raise ScenarioError(f"there is no standard test {name!r}; {near}; `evac verify` lists all")
        found += [test for test in known[name.lower()] if test not in found]
    return found


def of_standard(standard: str) -> list[StandardTest]:
    """Return the tests of a standard."""
    return [test for test in TESTS if any(name.startswith(f"{standard}-") for name in test.names)]


def _test(
    names: str, title: str, measure: Callable[[Trial], Iterable[Check]], runs: int = 1, by_design: str = ""
) -> StandardTest:
    return StandardTest(tuple(names.split()), title, measure, runs, by_design=by_design)


def _left_out(names: str, title: str, why: str) -> StandardTest:
    return StandardTest(tuple(names.split()), title, why=why)


#: Why the default passes more people through a door than IMO wants.
DOOR = "laboratories measured 1.7 to 2.7 /s through 1 m; --set behaviours.walking.preset=regulation passes it"
LIFTS = f"{NOT_YET}: needs lifts or escalators"

#: All tests, in the order of RiMEA, IMO, NIST and ISO.
TESTS: Sequence[StandardTest] = (
    _test("RiMEA-1", "40 m in a corridor at 1.33 m/s", partial(alone.corridor, speed=1.33, low=26.0, high=34.0)),
    _test("RiMEA-2", "10 m up a stair", partial(alone.stair, way="up", speed=0.5)),
    _test("RiMEA-3", "10 m down a stair", partial(alone.stair, way="down", speed=0.65)),
    _test("RiMEA-4", "fundamental diagram in a corridor", crowds.fundamental_diagram, 2),
    _test("RiMEA-5 IMO-5", "response times, and nobody moves before", alone.response, 5),
    _test("RiMEA-6 IMO-6 NIST-2.3 ISO-4", "twenty people round a corner", alone.round_a_corner, 3),
    _test("RiMEA-7", "walking speeds by age", alone.speeds_by_age),
    _test("RiMEA-8", "faster people leave a building earlier", choices.faster_people),
    _test("RiMEA-9 IMO-9", "1000 people by four doors and by two", crowds.four_and_two_doors),
    _test("RiMEA-10 IMO-10 NIST-3.1 ISO-8", "exits assigned to rooms", choices.assigned_exits, 3),
    _test("RiMEA-11", "the nearer and the emptier of two exits", choices.nearer_exit),
    _test("RiMEA-12", "bottlenecks: goal, length, two in a row, width", crowds.bottlenecks, 3),
    _test("RiMEA-13", "fundamental diagram on a stair", crowds.speeds_on_a_stair, 3),
    _test("RiMEA-14", "a short way over stairs or a detour", choices.detour_or_stairs),
    _test("RiMEA-15", "a crowd round a corner", crowds.corner_of_a_crowd),
    _test("RiMEA-16", "fundamental diagram in single file", crowds.single_file, 2),
    _test("IMO-1", "40 m in a corridor at 1 m/s", partial(alone.corridor, speed=1.0, low=39.0, high=41.0)),
    _test("IMO-2", "10 m up a stair at 1 m/s", partial(alone.stair, way="up", speed=1.0, flat=1.0)),
    _test("IMO-3", "10 m down a stair at 1 m/s", partial(alone.stair, way="down", speed=1.0, flat=1.0)),
    _test("IMO-4 NIST-5.2 ISO-11", "greatest flow through a door of 1 m", crowds.door_of_1_m, 3, DOOR),
    _test("IMO-7", "walking speeds of a class of people", alone.speeds_of_men),
    _test("IMO-8 NIST-2.8 ISO-6", "people who come towards each other", crowds.counterflow, 3),
    _test("IMO-11 NIST-5.1 ISO-10", "congestion before a corridor and a stair", crowds.congestion, 2),
    _test("IMO-12", "flow falls at high density", crowds.flow_falls_at_high_density, 2),
    _test("NIST-1.1 ISO-1", "distributions of response times", alone.response_distributions),
    _test("NIST-2.1 ISO-2", "speed in a corridor", alone.speed_in_corridor),
    _test("NIST-2.2", "100 m on stairs", alone.long_stair),
    _test("NIST-2.4 ISO-5", "assigned walking speeds", alone.speeds_of_a_normal_distribution),
    _test("NIST-2.5 ISO-18", "walking speed in smoke", alone.corridor_in_smoke),
    _test("NIST-2.6 ISO-19", "incapacitation by gases", alone.stopped_by_gases),
    _left_out("NIST-2.7 ISO-20", "lifts", LIFTS),
    _test("NIST-2.9", "a group with a slow member", choices.mixed_group, 3),
    _test("NIST-2.10 ISO-7", "a slow and wide person among others", crowds.slow_and_wide, 5),
    _test("NIST-3.2 ISO-15", "social influence on exits", choices.follow_others, 3),
    _test("NIST-3.3 ISO-16", "familiar exits", choices.familiar_exit, 5),
    _test("NIST-4.1 ISO-9", "an exit that becomes unavailable", choices.closing_exit),
    _test("ISO-3", "10 m of stair at half the speed", partial(alone.stair, way="up", speed=0.5, flat=1.0)),
    _test("ISO-12", "flow over stairs of five widths", crowds.wider_stairs),
    _test("ISO-13", "speeds in a corridor that fills", crowds.speeds_in_a_filled_corridor),
    _test("ISO-14", "a fast group among slow people", choices.fast_group, 5),
    _test("ISO-17", "the shorter way over storeys", choices.shorter_over_storeys),
    _left_out("ISO-21", "escalators", LIFTS),
    _left_out(
        "ISO-V",
        "its nine validation tests",
        f"{NOT_APPLICABLE}: their text and data were not available; see docs/evidence/people",
    ),
)
