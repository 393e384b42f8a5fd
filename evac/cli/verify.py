"""Commands that check evac itself: evac verify, evac evidence."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from evac.cli.inputs import declare_plugin, declare_set
from evac.cli.screen import note, say
from evac.evidence import KINDS

if TYPE_CHECKING:
    from evac.standard.verify import Result


TEST_FAILED = 1  #: Exit status if a test is failed, or named and not run.


def declare_verify(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac verify`."""
    parser.add_argument("tests", metavar="NAME", nargs="*", help="a test, a standard, or all; without: list the tests")
    declare_set(parser, "change keys of all cases, such as simulation.tick=0.05 behaviours.walking.preset=regulation")
    declare_plugin(parser)
    what = "people walk as in the paper, without the behaviour walking; --set adds another behaviour"
    parser.add_argument("--paper", action="store_true", help=what)
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="first seed (default: 1)")
    what = "folder of the page and of the results (default: ./verification)"
    parser.add_argument("--out", type=Path, default=Path("verification"), metavar="DIR", help=what)


def execute_verify(arguments: argparse.Namespace) -> int:
    """Run the standard tests of RiMEA, IMO, NIST and ISO.

    Without names, the tests are listed. Names are those of tests, such as RiMEA-9, IMO-4, NIST-2.1 or ISO-12, of whole
    standards (RiMEA, IMO, NIST, ISO), or `all`. Each run leaves its result folder in DIR/TEST, and
    DIR/verification.html is a page on all tests, with the verdict first.

    Exit status: 0 if all tests that were run are passed, 1 if not, or if a test that is named cannot be run.
    """
    from evac.standard.trial import Trial, probe
    from evac.standard.verify import FAILED, PASSED, STANDARDS, TESTS, find_tests

    if not arguments.tests:
        for test in TESTS:
            kind = f" ({test.why.partition(': ')[0]})" if test.why else ""
            say(f"{' '.join(test.names):32}{test.title}{kind}", indent=32)
        return 0
    tests = find_tests(arguments.tests)
    plugin_files = tuple(Path(path).resolve() for path in arguments.plugins)
    trial = Trial(arguments.out, settings=tuple(arguments.set), plugin_files=plugin_files, is_paper=arguments.paper)
    probe(trial)
    from evac.standard.verify import PAGE_NAME, verify

    results = verify(tests, trial, arguments.seed, show_result)
    print(arguments.out / PAGE_NAME)
    groups = {"all", *(standard.lower() for standard in STANDARDS)}
    named = find_tests(name for name in arguments.tests if name.lower() not in groups)
    wrong = [r for r in results if r.verdict == FAILED or (r.test in named and r.verdict != PASSED)]
    return TEST_FAILED if wrong else 0


def show_result(result: "Result") -> None:
    """Print the verdict on a test and its checks."""
    test = result.test
    say(f"{' '.join(test.names)}: {test.title}: {test.why or result.verdict}")
    if result.error:
        say(f"    error: {result.error}", indent=6)
    for check in result.checks:
        mean = "-" if check.mean is None else f"{check.mean:.4g}"
        verdict = "met" if check.is_passed else "NOT MET"
        blocked = f", {check.blocked} of {len(check.values)} runs blocked" if check.blocked else ""
        say(f"    {check.quantity}: {mean} (expected {check.band}){blocked}: {verdict}", indent=6)
    if test.by_design and not all(check.is_passed for check in result.checks):
        say(f"    fails by design: {test.by_design}", indent=6)
    sys.stdout.flush()


def declare_evidence(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac evidence`."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=f"what to compute: {', '.join(KINDS)}")
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="fewer and smaller cases: seconds instead of minutes")
    effort.add_argument("--page-only", action="store_true", help="only write the page again from the files in DIR/KIND")
    what = "folder; the page is written to DIR/KIND (default: evidence)"
    parser.add_argument("--out", type=Path, default=Path("evidence"), metavar="DIR", help=what)


def execute_evidence(arguments: argparse.Namespace) -> int:
    """Recompute tables, plots and pages on accuracy, stability, speed and validation."""
    from evac.evidence.command import run_evidence

    if not arguments.page_only:
        note(f"computing {arguments.kind} from scratch")
    print(run_evidence(arguments.kind, arguments.out, arguments.quick, page_only=arguments.page_only))
    return 0
