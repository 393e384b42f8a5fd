"""`evac verify`: carry out standard tests, and write one page on them."""

import csv
import subprocess
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from importlib.metadata import version
from itertools import starmap
from pathlib import Path
from typing import Any, TypeVar

from evac.base.errors import ResultError, RunWarning, SimulationError, usable_path
from evac.folder.files import COMPLETE, mark, read_manifest, replacing, writing
from evac.jit.loading import cores
from evac.report.pages import Cell, rendered, write_page
from evac.standard import tests as standard
from evac.standard.plans import Row
from evac.standard.trial import StandardTest, Trial

Result = TypeVar("Result")

#: Call by which runs do not warn: pages say what came of them.
QUIET: tuple[Callable[..., None], tuple[object, ...]] = (warnings.simplefilter, ("ignore", RunWarning))

#: Files of a checkout that affect the results.
CODE = (":/*.py", ":/*.toml", ":/*.msh")

#: Files of the folder of `evac verify`, beside those of the tests.
PAGE_NAME, TABLE_NAME = "verification.html", "verification.csv"

#: Verdicts in the order of the page, and the columns of checks that it shows.
VERDICTS = (standard.PASSED, standard.FAILED, standard.NOT_YET, standard.NOT_APPLICABLE)
SHOWN = ("test", "measured", "expected", "found", "runs", "blocked", "met", "by")


def verify(
    tests: Sequence[StandardTest], trial: Trial, seed: int, show: Callable[[standard.Result], None]
) -> list[standard.Result]:
    """Carry out tests, in processes if there are several, show each result in order, and write page and table."""
    _check(trial.folder, tests)
    results = []
    tasks = [(test, trial, seed) for test in tests]
    several = in_processes(standard.carry_out, tasks, cores(), "evac verify", "run the tests one by one")
    for result in several if len(tests) > 1 else starmap(standard.carry_out, tasks):
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


def page_of(results: Sequence[standard.Result], trial: Trial, seed: int) -> str:
    """Return the page on the results of tests: how many are passed, then each test, then each check."""
    of_each = {name: Counter[str]() for name in standard.STANDARDS}
    for result in results:
        for name in result.test.names:
            of_each[name.partition("-")[0]][result.verdict] += 1
    verdicts = Counter(result.verdict for result in results)
    return rendered(
        "standard_tests.html",
        title="Standard tests",
        kind="RiMEA 4.1.1, IMO MSC.1/Circ.1533, NIST TN 1822, ISO 20414",
        passed=verdicts[standard.PASSED],
        failed=[result.test for result in results if result.verdict == standard.FAILED],
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


def _reason(result: standard.Result) -> str:
    if result.verdict != standard.FAILED:
        return result.test.why.partition(": ")[2]
    missed = [f"{check.quantity}: {check.verdict}" for check in result.checks if not check.is_passed]
    return "; ".join(words for words in (*missed, result.error, result.test.by_design) if words)


def _cell(result: standard.Result) -> Cell:
    return Cell(result.verdict, {standard.PASSED: "good", standard.FAILED: "bad"}.get(result.verdict, "open"))


def _check_cell(key: str, value: object) -> object:
    return Cell(value, "good" if str(value).startswith("yes") else "bad") if key == "met" else value


def check_rows(result: standard.Result, **columns: Any) -> Iterator[Row]:
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
    function: Callable[..., Result], tasks: Iterable[tuple[Any, ...]], workers: int, what: str, remedy: str
) -> Iterator[Result]:
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
