"""Faults: plausible mistakes in the code, each of which the tests of its room must notice.

`faults.toml` lists them as data: a name, the file, the text to replace and what replaces it, and the test files.
``python -m tests.faults`` applies one after the other in a copy of the checkout and runs these test files.
docs/contributing.md says when.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

#: Folder of the checkout.
CHECKOUT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Fault:
    """A mistake: `old` occurs exactly once in `file` and becomes `new`; `tests` are files or folders."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]

    def applied(self, sound: str) -> str:
        """Return the content of the file with the mistake."""
        if sound.count(self.old) != 1:
            raise SystemExit(f"{self.name}: its text occurs {sound.count(self.old)} times in {self.file}, not once")
        return sound.replace(self.old, self.new)


def read_faults() -> dict[str, Fault]:
    """Return all faults by name, in the order of the list."""
    with (Path(__file__).parent / "faults.toml").open("rb") as file:
        found = [Fault(**one) for one in tomllib.load(file)["fault"]]
    return {one.name: one for one in found}
