"""`evac verify`: carry out standard tests, and write one page on them."""

import csv
import re
import subprocess
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import starmap
from pathlib import Path
from typing import Any, TypeVar

from evac.base.errors import ResultError, RunWarning, ScenarioError, SimulationError, usable_path
from evac.base.parameters import did_you_mean
from evac.folder.files import COMPLETE, mark, read_manifest, replacing, writing
from evac.jit.loading import cores
from evac.report.pages import Cell, rendered, write_page
from evac.standard import alone, choices, crowds  # noqa: F401
from evac.standard.plans import Row
from evac.standard.trial import MADE, Check, StandardTest, Trial

#: The documents, the sources in which they were read since not all originals were available, and their tests.
STANDARDS = {
    "RiMEA": "RiMEA guideline 4.1.1 (2025), annex 1; read: drawings of 3.0 in jpscore, 4.1.1 in quotations",
    "IMO": "IMO MSC.1/Circ.1533 (2016), annex 3, appendix 2; read in FDS+Evac's guide and community documents",
    "NIST": "NIST TN 1822 (Ronchi et al. 2013); read in a port by the community, whose dimensions may differ",
    "ISO": "ISO 20414:2020, verification tests; read in community documents, whose dimensions may differ",
}

PASSED, FAILED, NOT_APPLICABLE = "passed", "FAILED", "not applicable"

DATA = f"{NOT_APPLICABLE}: their text and data were not available; see docs/evidence/people"

LEFT_OUT = (StandardTest(("ISO-V",), "its nine validation tests", why=DATA),)


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
            return NOT_APPLICABLE
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


Answer = TypeVar("Answer")

#: Call by which runs do not warn: pages say what came of them.
QUIET: tuple[Callable[..., None], tuple[object, ...]] = (warnings.simplefilter, ("ignore", RunWarning))

CODE = (":/*.py", ":/*.toml", ":/*.msh")  #: Files of a checkout that affect the results.

#: Files of the folder of `evac verify`, beside those of the tests.
PAGE_NAME, TABLE_NAME = "verification.html", "verification.csv"

#: Verdicts in the order of the page, and the columns of checks that it shows.
VERDICTS = (PASSED, FAILED, NOT_APPLICABLE)
SHOWN = ("test", "measured", "expected", "found", "runs", "blocked", "met", "by")


def verify(tests: Sequence[StandardTest], trial: Trial, seed: int, show: Callable[[Result], None]) -> list[Result]:
    """Carry out tests, in processes if there are several, show each result in order, and write page and table."""
    _check(trial.folder, tests)
    results = []
    tasks = [(test, trial, seed) for test in tests]
    several = in_processes(carry_out, tasks, cores(), "evac verify", "run the tests one by one")
    for result in several if len(tests) > 1 else starmap(carry_out, tasks):
        show(result)
        results.append(result)
    with writing("the verification", trial.folder):
        trial.folder.mkdir(parents=True, exist_ok=True)
        mark(trial.folder, COMPLETE, trial.folder.name)
    write_page(page_of(results, trial, seed), trial.folder / PAGE_NAME)
    rows = [row for result in results for row in check_rows(result)]
    if rows:
        write_rows(trial.folder / TABLE_NAME, rows)
    return results


def _check(folder: Path, tests: Sequence[StandardTest]) -> None:
    """Refuse files in the places of page and table that earlier verifications have not written, and links."""
    usable_path(folder, ResultError)
    with writing("the verification", folder):
        own = read_manifest(folder).files
        for path in (folder / PAGE_NAME, folder / TABLE_NAME):
            if path.is_symlink() or (path.exists() and path.name not in own):
                raise ResultError(f"{path}: not written by evac verify; move it away, or choose another folder (--out)")
        for place in (folder / test.name for test in tests):
            for path in (place, *place.glob("*")):
                if path.is_symlink():
                    raise ResultError(
                        f"{path}: a link, which results are not written through; remove it, or choose another --out"
                    )


def page_of(results: Sequence[Result], trial: Trial, seed: int) -> str:
    """Return the page on the results of tests: how many are passed, then each test, then each check."""
    of_each = {name: Counter[str]() for name in STANDARDS}
    for result in results:
        for name in result.test.names:
            of_each[name.partition("-")[0]][result.verdict] += 1
    verdicts = Counter(result.verdict for result in results)
    return rendered(
        "standard_tests.html",
        title="Standard tests",
        kind="RiMEA 4.1.1, IMO MSC.1/Circ.1533, NIST TN 1822, ISO 20414",
        passed=verdicts[PASSED],
        failed=[result.test for result in results if result.verdict == FAILED],
        words=VERDICTS,
        standards=[(name, *(own[word] for word in VERDICTS)) for name, own in of_each.items() if own],
        facts_of_run={
            "Movement": "as in the paper" if trial.is_paper else "as in new cases",
            "Settings (--set)": " ".join(trial.settings) or "none",
            "Plugin files": ", ".join(map(str, trial.plugin_files)) or "none",
            "First seed": str(seed),
            "Program": f"evac {version('evac')} {commit()}".strip(),
        },
        tests=[(" ".join(result.test.names), result.test.title, _cell(result), _reason(result)) for result in results],
        checks=[[_check_cell(key, row[key]) for key in SHOWN] for result in results for row in check_rows(result)],
        columns=SHOWN,
    )


def _reason(result: Result) -> str:
    if result.verdict != FAILED:
        return result.test.why.partition(": ")[2]
    missed = [f"{check.quantity}: {check.verdict}" for check in result.checks if not check.is_passed]
    return "; ".join(words for words in (*missed, result.error, result.test.by_design) if words)


def _cell(result: Result) -> Cell:
    return Cell(result.verdict, {PASSED: "good", FAILED: "bad"}.get(result.verdict, "open"))


def _check_cell(key: str, value: object) -> object:
    return Cell(value, "good" if str(value).startswith("yes") else "bad") if key == "met" else value


def check_rows(result: Result, **columns: Any) -> Iterator[Row]:
    """Return a row for each check of a test, and one for its error, if it ended with one."""
    name = {"test": " ".join(result.test.names), **columns}
    if result.error:
        words = {"measured": result.error, "expected": "a run without errors", "by": "-"}
        yield {**name, **words, "found": None, "from": None, "to": None, "runs": 0, "blocked": 0, "met": "NO: error"}
    for check in result.checks:
        low, high = check.interval or (None, None)
        yield {
            **name,
            **{"measured": check.quantity, "expected": check.band, "by": check.source},
            **{"found": check.mean, "from": low, "to": high},
            **{"runs": len(check.values), "blocked": check.blocked, "met": check.verdict},
        }


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write rows, whose columns are the keys of the first one, to a CSV file, which they replace as a whole."""
    with replacing(path, "the table") as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def in_processes(
    function: Callable[..., Answer], tasks: Iterable[tuple[Any, ...]], workers: int, what: str, remedy: str
) -> Iterator[Answer]:
    """Yield ``function(*task)`` for each task in order, in processes; the error about one that died has the remedy."""
    from evac.base.processes import Pool

    with Pool(workers, *QUIET) as pool:
        for future in [pool.submit(function, *task) for task in tasks]:
            try:
                result = future.result()
            except BrokenExecutor as error:
                raise SimulationError(
                    f"{what}: a worker process ended unexpectedly, possibly for lack of memory: {error}; {remedy}"
                ) from error
            yield result


def commit(file: Path = Path(__file__)) -> str:
    """Return the commit of a checked-out file, with ``-dirty`` if code has changed since; empty if there is none.

    An installed package may lie inside another checkout, so only files tracked by git count. Changed pages are not
    changed code.
    """
    git = ["git", "-C", str(file.resolve().parent)]
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", file.name], check=True, capture_output=True)
        described = [*git, "describe", "--always", "--abbrev=12"]
        description = subprocess.run(described, check=True, capture_output=True, text=True).stdout.strip()
        changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", *CODE], capture_output=True).returncode
    except (OSError, subprocess.CalledProcessError):
        return ""
    return f"{description}-dirty" if changed else description
