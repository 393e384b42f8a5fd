"""Apply faults one by one and tell which the tests notice: ``python -m tests.faults [NAME ...]`` in the checkout.

``--draw NUMBER`` draws faults instead (`drawn.py`), and ``--suite`` repeats those that the tests of their room miss
with all tests.

A copy of the checkout is made in a temporary folder, without data beside it. There, the tests of the chosen faults must
pass first. Then each fault is applied, its tests are run up to the first that fails, and the file is restored. The
exit status is 1 if a fault is not caught, and 2 if the tests fail without any.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from fnmatch import filter as names_like
from pathlib import Path
from typing import TYPE_CHECKING

from tests.faults import CHECKOUT, Fault, read_faults

if TYPE_CHECKING:
    from tests.faults.drawn import Mutant

#: Wall time of the tests of a fault; a run that takes longer is stopped, and the fault counts as caught [s].
LONGEST = 900.0
#: Names of packages, and their folders in the checkout.
PACKAGES = {"evac": "evac", "evac_plugins": "plugins", "evac_buildings": "buildings"}


def main() -> int:
    """Try the faults that the arguments name and return the exit status."""
    faults = read_faults()
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="faults, with * for any text; all if there is none")
    parser.add_argument("--draw", type=int, metavar="NUMBER", help="draw so many faults that nobody chose")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument(
        "--room", action="append", default=[], help="draw in files that begin so: evac/people, plugins/"
    )
    parser.add_argument("--suite", action="store_true", help="repeat what is not caught with the whole suite")
    arguments = parser.parse_args()
    wanted = arguments.names or ["*"]
    if unknown := [name for name in wanted if not names_like(faults, name)]:
        parser.error(f"{', '.join(unknown)}: no such fault; of {', '.join(faults)}")
    chosen: list[Fault] | list[Mutant] = [
        fault for name, fault in faults.items() if any(names_like([name], pattern) for pattern in wanted)
    ]
    if arguments.draw:
        from tests.faults.drawn import drawn  # which needs cosmic-ray

        chosen = [*drawn(arguments.draw, arguments.seed, arguments.room)]
    with tempfile.TemporaryDirectory(prefix="evac-faults-") as folder:
        copy = _copied(Path(folder))
        every = sorted({tests for fault in chosen for tests in fault.tests})
        status, _, output = _tested(copy, every, None)
        if status != 0:
            print(f"{output}\nthe tests fail without a fault; the trial says nothing before they pass")
            return 2
        print("the tests pass without a fault\n")
        print(f"{'fault':50} {'result':11} {'seconds':>7}  first test that fails")
        missed = [fault for fault in chosen if not _is_caught(copy, fault, fault.tests)]
        print(f"\n{len(chosen) - len(missed)} of {len(chosen)} faults are caught by the tests of their room")
        if arguments.suite and missed:
            missed = [fault for fault in missed if not _is_caught(copy, fault, ["tests"])]
            print(f"\n{len(chosen) - len(missed)} of {len(chosen)} faults are caught by the suite")
    return 1 if missed else 0


def _copied(folder: Path) -> Path:
    """Return a copy of the checkout in a folder, with byte code that is checked against the content of each file."""
    copy = folder / "evac"
    shutil.copytree(CHECKOUT, copy, ignore=_left_out, symlinks=True)
    (folder / "source").mkdir()
    for package, place in PACKAGES.items():
        (folder / "source" / package).symlink_to(copy / place)
    # Files are replaced within the resolution of their dates, so that byte code checked by date could be stale.
    compiling = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "evac", "plugins"]
    subprocess.run(compiling, cwd=copy, check=True)
    return copy


def _left_out(folder: str, names: list[str]) -> set[str]:
    """Return what is not copied of a folder: history, byte code and virtual environments."""
    environments = {name for name in names if (Path(folder) / name / "pyvenv.cfg").exists()}
    return environments | {".git", "__pycache__"}


def _is_caught(copy: Path, fault: "Fault | Mutant", tests: list[str]) -> bool:
    """Return whether tests fail with a fault, and print a row of the table."""
    path = copy / fault.file
    sound = path.read_text(encoding="utf-8")
    path.write_text(fault.applied(sound), encoding="utf-8")
    try:
        status, seconds, output = _tested(copy, tests, LONGEST)
    finally:
        path.write_text(sound, encoding="utf-8")
    if status not in (None, 0, 1, 2, 3, 4):  # 2 to 4: a test file or its conftest cannot be imported
        raise SystemExit(f"{fault.name}: pytest ends with status {status}:\n{output}")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
    place = failed[1] if failed else f"none within {LONGEST:.0f} s" if status is None else ""
    print(f"{fault.name:50} {'caught' if status != 0 else 'NOT CAUGHT':11} {seconds:7.1f}  {place}", flush=True)
    if status == 0:
        for sign, text in (("-", fault.old), ("+", fault.new)):
            print("".join(f"    {sign} {line}\n" for line in text.splitlines()), end="")
    return status != 0


def _tested(copy: Path, tests: list[str], longest: float | None) -> tuple[int | None, float, str]:
    """Run test files up to the first failure: exit status, None if they take too long, wall time [s] and output."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "-n", "0", "-p", "no:cacheprovider", *tests]
    own = {"PYTHONPATH": str(copy.parent / "source"), "PYTHONDONTWRITEBYTECODE": "1"}
    own["EVAC_CACHE_DIR"] = str(copy.parent / "cache")  # kernels with faults do not stay on this machine
    begun = time.perf_counter()
    process = subprocess.Popen(
        command,
        cwd=copy,
        env=os.environ | own,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=longest)
        status: int | None = process.returncode
    except BaseException as error:  # an interrupt too, which the tests in their session do not see
        os.killpg(process.pid, signal.SIGKILL)
        output, _ = process.communicate()
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        status = None
    return status, time.perf_counter() - begun, output


if __name__ == "__main__":
    sys.exit(main())
