"""The list of standard tests: those of the modules beside this one, and those that are not run."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from evac.base.errors import ScenarioError, SimulationError
from evac.base.parameters import did_you_mean

# The modules add their tests to MADE.
from evac.standard import alone, choices, crowds  # noqa: F401
from evac.standard.trial import MADE, Check, StandardTest, Trial

#: The documents, the sources in which they were read since not all originals were available, and their tests.
STANDARDS = {
    "RiMEA": "RiMEA guideline 4.1.1 (2025), annex 1; read: drawings of 3.0 in jpscore, 4.1.1 in quotations",
    "IMO": "IMO MSC.1/Circ.1533 (2016), annex 3, appendix 2; read in FDS+Evac's guide and community documents",
    "NIST": "NIST TN 1822 (Ronchi et al. 2013); read in a port by the community, whose dimensions may differ",
    "ISO": "ISO 20414:2020, verification tests; read in community documents, whose dimensions may differ",
}

PASSED, FAILED, NOT_YET, NOT_APPLICABLE = "passed", "FAILED", "not yet", "not applicable"

LIFTS = f"{NOT_YET}: needs lifts or escalators"
DATA = f"{NOT_APPLICABLE}: their text and data were not available; see docs/evidence/people"

LEFT_OUT = (
    StandardTest(("NIST-2.7", "ISO-20"), "lifts", why=LIFTS),
    StandardTest(("ISO-21",), "escalators", why=LIFTS),
    StandardTest(("ISO-V",), "its nine validation tests", why=DATA),
)


def _place(test: StandardTest) -> tuple[int, list[int]]:
    """Return the place of a test in the list: by standard, then by the numbers in its first name, ISO-V last."""
    standard, _, number = test.name.partition("-")
    return list(STANDARDS).index(standard), [int(part) for part in re.findall(r"\d+", number)] or [99]


#: All tests, in the order of RiMEA, IMO, NIST and ISO.
TESTS: Sequence[StandardTest] = tuple(sorted([*MADE, *LEFT_OUT], key=_place))


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
    """Return the tests with given names, each once: of a test, of a standard, or "all"."""
    tests: list[StandardTest] = []
    known = {name.lower(): [test] for test in TESTS for name in test.names}
    known |= {standard.lower(): of_standard(standard) for standard in STANDARDS} | {"all": list(TESTS)}
    for name in names:
        if name.lower() not in known:
            standard = next((key for key in STANDARDS if name.lower().startswith(key.lower())), "")
            words = [key for test in of_standard(standard) for key in test.names] if standard else ["all", *STANDARDS]
            near = did_you_mean(f"{standard}{name[len(standard) :]}", words)
            raise ScenarioError(f"there is no standard test {name!r}; {near}; `evac verify` lists all")
        tests += [test for test in known[name.lower()] if test not in tests]
    return tests


def of_standard(standard: str) -> list[StandardTest]:
    """Return the tests of a standard."""
    return [test for test in TESTS if any(name.startswith(f"{standard}-") for name in test.names)]
