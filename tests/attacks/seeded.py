"""Cases that a kind and a number determine."""

import random
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """One case of a kind, such as a key of the changes of a family."""

    kind: str
    seed: int

    def __str__(self) -> str:
        return f"{self.kind}-{self.seed}"


def in_turn(kinds: Collection[str], crashers: tuple[Case, ...] = ()) -> Callable[[int, int], Iterator[Case]]:
    """Return what yields the crashers, then a number of cases that a seed determines; each kind in turn."""

    def cases(number: int, seed: int) -> Iterator[Case]:
        yield from crashers
        generator, names = random.Random(seed), list(kinds)
        for k in range(number):
            yield Case(names[k % len(names)], generator.randrange(10**6))

    return cases
