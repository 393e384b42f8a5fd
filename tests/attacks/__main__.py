"""Run attacks with limits: ``python -m tests.attacks --all`` in the checkout.

Every case runs in a process that may take 4 GB of memory and 60 s of the processor; one that takes more, that ends its
process or that raises is told, with what runs it again alone. The exit status is 1 if there was one.
"""

import argparse
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

from tests.attacks.families import FAMILIES, Family

#: Of a case: time of the processor, wall time on a machine that is used for other things too [s], memory [bytes].
MOST_SECONDS, LONGEST, MOST_BYTES = 60.0, 900.0, 4_000_000_000


def main() -> int:
    """Run what the arguments name and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.attacks", description=__doc__)
    parser.add_argument("families", nargs="*", metavar="FAMILY", help=f"of {', '.join(FAMILIES)}")
    parser.add_argument("--all", action="store_true", help="all families")
    parser.add_argument("--seed", type=int, default=1, help="of the cases (1)")
    parser.add_argument("--number", type=int, help="of cases of each family (as many as the full attack has)")
    parser.add_argument("--only", type=int, metavar="K", help="run case K alone, in this process")
    arguments = parser.parse_args()
    names = list(FAMILIES) if arguments.all else arguments.families
    if not names or any(name not in FAMILIES for name in names):
        parser.error(f"name families: {', '.join(FAMILIES)}, or --all")
    failures = 0
    for name in names:
        family = FAMILIES[name]
        number = arguments.number or family.number
        cases = family.cases(number, arguments.seed)
        if arguments.only is not None:
            print(_run(family, next(islice(cases, arguments.only, None))))
            continue
        failures += attack(
            name, family, list(cases), f"--seed {arguments.seed} --number {arguments.number or family.number}"
        )
    return 1 if failures else 0


def attack(name: str, family: Family, cases: list[Any], how: str) -> int:
    """Run cases, tell what came of them, and return how many failed."""
    started, first = time.perf_counter(), 0
    outcomes: Counter[str] = Counter()
    failures, slowest, peak = 0, 0.0, 0.0
    while first < len(cases):
        for k, outcome, seconds, memory in _in_process(family, cases, first):
            first = k + 1
            slowest, peak = max(slowest, seconds), max(peak, memory)
            if outcome.startswith("FAILED"):
                failures += 1
                print(
                    f"{name} {k}: {cases[k]}\n{outcome}\nagain: python -m tests.attacks {name} {how} --only {k}\n",
                    flush=True,
                )
            else:
                outcomes[outcome] += 1
    counts = ", ".join(f"{number} {outcome}" for outcome, number in outcomes.most_common())
    print(
        f"{name}: {len(cases)} cases, {failures} failed ({counts}); slowest {slowest:.1f} s of the processor, most "
        f"memory {peak / 1e9:.2f} GB, {time.perf_counter() - started:.0f} s in all",
        flush=True,
    )
    return failures


def _in_process(family: Family, cases: list[Any], first: int) -> Any:
    """Yield (case, outcome, seconds, bytes) of cases from a process, until it ends or takes too long."""
    reading, writing = os.pipe()
    process = os.fork()
    if not process:
        os.close(reading)
        _serve(family, cases, first, os.fdopen(writing, "w"))
    os.close(writing)
    answers, buffer, k = reading, b"", first
    started = time.perf_counter()
    while True:
        left = started + LONGEST - time.perf_counter()
        if not select.select([answers], [], [], max(0.0, left))[0]:
            os.kill(process, 9)
            os.waitpid(process, 0)
            os.close(reading)
            yield k, "FAILED: takes too long", time.perf_counter() - started, 0.0
            return
        read = os.read(answers, 65536)
        if not read:
            break
        buffer += read
        while b"\0" in buffer:
            answer, _, buffer = buffer.partition(b"\0")
            memory, seconds, outcome = answer.decode(errors="replace").split(" ", 2)
            if float(memory) > MOST_BYTES:
                outcome = f"FAILED: {float(memory) / 1e9:.1f} GB of memory"
            yield k, outcome, float(seconds), float(memory)
            started, k = time.perf_counter(), k + 1
    os.close(reading)
    _, status = os.waitpid(process, 0)
    if k < len(cases):
        code = os.waitstatus_to_exitcode(status)
        takes = f" (more than {MOST_SECONDS:g} s)" if code == -signal.SIGPROF else ""
        yield k, f"FAILED: the process ended with status {code}{takes}", 0.0, 0.0


def _serve(family: Family, cases: list[Any], first: int, answers: Any) -> None:
    """Run cases from one on and answer with the memory taken so far, the time of each and what came of it."""
    resource.setrlimit(resource.RLIMIT_AS, (2 * MOST_BYTES, 2 * MOST_BYTES))
    for case in cases[first:]:
        started = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)  # which ends the process
        try:
            outcome = _run(family, case)
        except BaseException:
            outcome = "FAILED: " + traceback.format_exc()[-3000:]
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        answers.write(f"{memory} {time.process_time() - started} {outcome}\0")
        answers.flush()
    os._exit(0)


def _run(family: Family, case: Any) -> str:
    """Run a case in an empty folder, which is removed."""
    folder = Path(tempfile.mkdtemp(prefix="evac-attack-"))
    try:
        return family.run(case, folder) or "held"
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
