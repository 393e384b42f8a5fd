"""Attacks on the cache of kernels: damaged, forbidden or full, a run gives the same result with one warning at most."""

import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from evac.jit.store import Store, user_store
from tests.attacks.commands import write_case
from tests.attacks.seeded import Case, in_turn

COMMAND = [sys.executable, "-m", "evac", "run"]

#: Without the replay, which is larger than the files that a full disk still takes here, and without response times, of
#: which a run so short warns.
QUIET = ("output.replay=false", "behaviours.response_time=false")

#: Longest time of a run in which everything has to be compiled [s].
LONGEST = 300.0


def run(case: Case, folder: Path) -> str:
    """Run a small case with a damaged cache, and compare with the run whose cache is whole."""
    write_case(folder)
    place = folder / "cache"
    _copy(place / "kernels")
    generator = random.Random(f"{case}")
    environment = DAMAGES[case.kind](place / "kernels", generator) or {}
    said = _run(folder, {"EVAC_CACHE_DIR": str(place)} | environment)
    people = (folder / "result" / "people.csv").read_bytes()
    assert people == expected(), "another result"
    assert said.count("warning: ") <= 1, said
    assert "Traceback" not in said, said
    return "warned" if "warning: " in said else "silent"


@cache
def expected() -> bytes:
    """Return the table of people of the same run with the cache as it is."""
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        write_case(Path(name))
        _run(Path(name), {})
        return (Path(name) / "result" / "people.csv").read_bytes()


def _run(folder: Path, environment: dict[str, str]) -> str:
    """Run the case in a process of its own and return what it says on standard error."""
    limit = int(environment.pop("LIMIT", -1))

    def limited() -> None:
        if limit >= 0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run(
        [*COMMAND, str(folder / "case.toml"), "--out", str(folder / "result"), "--set", *QUIET],
        env=os.environ | environment,
        preexec_fn=limited,
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    assert done.returncode in (0, 3), (done.returncode, done.stderr)
    return done.stderr


def _copy(folder: Path) -> None:
    """Copy the kernels that the case needs: those used last."""
    expected()
    store = user_store()
    folder.mkdir(parents=True, mode=0o700)
    for path in store.entries() if store else []:
        with suppress(FileNotFoundError):  # another process has removed it for lack of room
            shutil.copy(path, folder / path.name)
            (folder / path.name).chmod(0o600)


def _some(folder: Path, generator: random.Random) -> list[Path]:
    """Return one of the files, or a few."""
    return generator.sample(Store(folder).entries(), generator.choice((1, 1, 3)))


def _changed(change: Callable[[bytes, random.Random], bytes]) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, generator: random.Random) -> None:
        for path in _some(folder, generator):
            path.write_bytes(change(path.read_bytes(), generator))

    return damage


def _flipped(content: bytes, generator: random.Random) -> bytes:
    wrong = bytearray(content)
    wrong[generator.randrange(len(wrong))] ^= 1 << generator.randrange(8)
    return bytes(wrong)


def _exchanged(folder: Path, generator: random.Random) -> None:
    """Put the content of one file under the name of another."""
    one, other = generator.sample(Store(folder).entries(), 2)
    one.write_bytes(other.read_bytes())


def _writable(folder: Path, generator: random.Random) -> None:
    for path in _some(folder, generator):
        path.chmod(0o666)


def _replaced(make: Callable[[Path], object]) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, generator: random.Random) -> None:
        for path in _some(folder, generator):
            path.unlink()
            make(path)

    return damage


def _no_folder(folder: Path, generator: random.Random) -> None:
    shutil.rmtree(folder)
    folder.write_text("a file where the folder should be")


def _limited(folder: Path, generator: random.Random) -> dict[str, str]:
    """Let no file be longer than the longest that a run writes, and some kernels be missing: as on a full disk."""
    large = [path for path in Store(folder).entries() if path.stat().st_size > 50_000]
    for path in large[:2]:
        path.unlink()
    return {"LIMIT": "50000"}


DAMAGES: dict[str, Callable[[Path, random.Random], dict[str, str] | None]] = {
    "empty": _changed(lambda content, generator: b""),
    "garbage": _changed(lambda content, generator: generator.randbytes(generator.randrange(5000))),
    "flipped": _changed(_flipped),
    "cut": _changed(lambda content, generator: content[: generator.randrange(len(content))]),
    "longer": _changed(lambda content, generator: content + generator.randbytes(10)),
    "zeros": _changed(lambda content, generator: bytes(len(content))),
    "exchanged": _exchanged,
    "writable file": _writable,
    "folder": _replaced(lambda path: path.mkdir()),
    "pipe": _replaced(lambda path: os.mkfifo(path)),
    "dangling link": _replaced(lambda path: path.symlink_to("/nowhere/at/all")),
    "missing": _replaced(lambda path: None),
    "writable folder": lambda folder, generator: folder.chmod(0o777),
    "a file for the folder": _no_folder,
    "full disk": _limited,
}


#: Cases of a number and a seed.
cases = in_turn(DAMAGES)
