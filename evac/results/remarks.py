"""What a run says besides its numbers: people who are left inside, are stuck, or left by another exit."""

from collections import Counter
from typing import TYPE_CHECKING

from evac.base.errors import counted

if TYPE_CHECKING:
    from evac.results.results import Results


def remarks_of(results: "Results") -> tuple[str, ...]:
    """Return one line for each kind of people who did not leave as their route says; see `Results.remarks`."""
    people, level, names = results.number_of_people, results.crowd.level, list(results.levels)
    lines = []
    if left := people - results.evacuated:
        number = Counter(level[level >= 0].tolist())
        where = ", ".join(f"{number[index]} on {names[index]!r}" for index in sorted(number))
        waiting = results.not_started
        late = f"; {waiting} of them had not started, because their response time was not over" if waiting else ""
        lines.append(f"{left} of {_people(people)} still inside ({results.ended}): {where}{late}")
    if pushed := len(results.left_by_other_exits):
        lines.append(f"{_people(pushed)} left by an exit that is not on the route, for example pushed through it")
    if results.stuck:
        first = results.stuck[0]
        x, y = results.crowd.position[first]
        lines.append(
            f"{_people(len(results.stuck))} without progress at the end, the first at ({x:.2f}, {y:.2f}) on "
            f"{names[level[first]]!r}: bodies in contact can block a narrow passage permanently, because people "
            "do not turn or give way; compare several seeds, or a wider passage"
        )
    return tuple(lines)


def _people(number: int) -> str:
    return counted(number, "person", "people")
