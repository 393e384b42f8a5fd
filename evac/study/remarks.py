"""What a study says besides its statistics: people left inside, intervals that are too wide, and quality warnings."""

import math
from typing import TYPE_CHECKING

from evac.errors import counted

if TYPE_CHECKING:
    from evac.study.study import Study

#: Maximum number of kinds of quality warnings that are told.
MOST_WARNINGS = 10

#: Maximum number of seeds that are listed.
MOST_SEEDS = 20


def remarks_of(study: "Study") -> list[str]:
    """Return lines on people left inside, and on intervals that are wider than required."""
    return [*_blocked(study), *_too_wide(study)]


def quality_of(study: "Study") -> list[str]:
    """Return the quality warnings of all runs: one line for each kind, with the first run and the number of others."""
    found: dict[str, list[str]] = {}
    for row in study.rows(columns=["point", "seed", "quality_warnings"]):
        where = f"seed {row['seed']}" if len(study.points) == 1 else f"point {row['point']}, seed {row['seed']}"
        for line in row["quality_warnings"]:
            found.setdefault(_kind(line), []).append(f"{where}: {line}")
    told = []
    for lines in list(found.values())[:MOST_WARNINGS]:
        others = counted(len(lines) - 1, "more run")
        told.append(lines[0] + (f" (and {others} with such a warning, in runs.csv)" if len(lines) > 1 else ""))
    return told


def _blocked(study: "Study") -> list[str]:
    """Return a line on blocked runs, if there are any."""
    if not any(one.blocked for one in study.statistics):
        return []
    if len(study.points) > 1:
        return ["people are left in blocked runs: percentiles count their times as infinite, means exclude these runs"]
    one = study.statistics[0]
    seeds = [str(row["seed"]) for row in study.rows(0, ["seed", "blocked"]) if row["blocked"]]
    listed = ", ".join(seeds[:MOST_SEEDS]) + (" and others" if len(seeds) > MOST_SEEDS else "")
    return [
        f"people are left in {one.blocked} of {one.runs} runs ({100 * one.blocked_share:.1f} %, 95 % interval "
        f"{100 * one.blocked_low:.1f} to {100 * one.blocked_high:.1f} %), with seeds {listed}; percentiles count their "
        "times as infinite, means exclude these runs; evac run --seed N shows where people are left"
    ]


def _too_wide(study: "Study") -> list[str]:
    """Return a line for each point at which a study has not reached the required interval."""
    rule = study.rule
    lines = []
    for point in study.points if rule.until is not None else ():
        if not rule.is_known(study.times(point.index), study.populations(point.index)):
            found = study.deciding(point.index)
            where = f" at {point.label}" if len(study.points) > 1 else ""
            half = found.relative_half_width
            reached = f"half-width {100 * half:.2g} %" if math.isfinite(half) else "no finite interval"
            lines.append(
                f"interval of the {found.name} too wide{where} after {counted(study.runs_of(point.index), 'run')}: "
                f"{reached}, required {100 * (rule.until or 0.0):g} %; {found.note or 'raise --most'}"
            )
    return lines


def _kind(line: str) -> str:
    """Return the words with which a warning begins, without numbers."""
    return "".join(sign for sign in line.partition(":")[0] if not sign.isdigit())
