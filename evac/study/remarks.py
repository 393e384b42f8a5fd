"""What a study says besides its statistics: failed runs, people left inside, intervals that are too wide, quality."""

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from evac.base.errors import counted
from evac.study.points import STEP

if TYPE_CHECKING:
    from evac.study.study import Study

#: Maximum number of kinds of quality warnings that are told.
MOST_WARNINGS = 10

#: Maximum number of seeds that are listed.
MOST_SEEDS = 20


def remarks_of(study: "Study") -> list[str]:
    """Return lines on failed runs, people left inside, wider intervals than required, and the effect of the step."""
    return [*_failed(study), *_blocked(study), *_too_wide(study), *_step(study)]


def quality_of(study: "Study") -> list[str]:
    """Return the quality warnings of all runs: one line for each kind, with the first run and the number of others."""
    seeds: dict[str, list[str]] = {}
    for row in study.rows(columns=["point", "seed", "quality_warnings"]):
        for line in row["quality_warnings"]:
            kind = "".join(sign for sign in line.partition(":")[0] if not sign.isdigit())
            seeds.setdefault(kind, []).append(f"{_where(study, row)}: {line}")
    return _first_of_each(seeds.values(), " with such a warning")


def _first_of_each(texts: Iterable[list[str]], which: str = "") -> list[str]:
    """Return the first line of each kind, with the number of other runs."""
    told = []
    for lines in list(texts)[:MOST_WARNINGS]:
        others = counted(len(lines) - 1, "more run")
        told.append(lines[0] + (f" (and {others}{which}, in runs.csv)" if len(lines) > 1 else ""))
    return told


def _failed(study: "Study") -> list[str]:
    """Return a line for the first failed run of each point."""
    reasons: dict[int, list[str]] = {}
    if any(estimates.failed for estimates in study.statistics):
        for row in study.rows(columns=["point", "seed", "error"], failed=True):
            if row["error"] is not None:
                reasons.setdefault(row["point"], []).append(f"failed: {_where(study, row)}: {row['error']}")
    told = _first_of_each(reasons.values())
    if len(reasons) > MOST_WARNINGS:
        told.append(f"failed: runs of {len(reasons) - MOST_WARNINGS} more points, in runs.csv")
    return told


def _step(study: "Study") -> list[str]:
    """Return a line on the effect of the time step, if it is more than chance or not determined."""
    change = study.step_change
    if change is None or change.low <= 0.0 <= change.high:
        return []
    if not change.has_interval:
        return ["the runs do not determine the effect of the time step; make more (--runs)"]
    step, share = study.points[1].parameters[STEP], 100.0 * change.value / study.statistics[0].mean.value
    return [
        f"the time step changes the mean by more than chance: {share:+.1f} % with half of it; use --set "
        f"{STEP}={step:g}, and check that step again"
    ]


def _where(study: "Study", row: Mapping[str, Any]) -> str:
    """Return the seed of a row, and its point if there are several."""
    if len(study.points) == 1:
        return f"seed {row['seed']}"
    return f"point {row['point']} ({study.points[row['point']].label}), seed {row['seed']}"


def _blocked(study: "Study") -> list[str]:
    """Return a line on blocked runs, if there are any."""
    if not any(of.blocked for of in study.statistics):
        return []
    if len(study.points) > 1:
        return ["people are left in blocked runs: percentiles count their times as infinite, means exclude these runs"]
    of = study.statistics[0]
    seeds = [str(row["seed"]) for row in study.rows(0, ["seed", "blocked"]) if row["blocked"]]
    listed = ", ".join(seeds[:MOST_SEEDS]) + (" and others" if len(seeds) > MOST_SEEDS else "")
    return [
        f"people are left in {of.blocked} of {of.runs} runs ({100 * of.blocked_share:.1f} %, 95 % interval "
        f"{100 * of.blocked_low:.1f} to {100 * of.blocked_high:.1f} %), with seeds {listed}; percentiles count their "
        "times as infinite, means exclude these runs; evac run --seed N shows where people are left"
    ]


def _too_wide(study: "Study") -> list[str]:
    """Return a line for each point at which a study has not reached the required interval."""
    rule = study.rule
    lines = []
    for point in study.points if rule.until is not None else ():
        if not rule.is_known(study.times(point.index), study.populations(point.index)):
            estimate = study.deciding(point.index)
            where = f" at {point.label}" if len(study.points) > 1 else ""
            half = estimate.relative_half_width
            reached = f"half-width {100 * half:.2g} %" if math.isfinite(half) else "no finite interval"
            if not rule.is_open(study.times(point.index), study.populations(point.index)):
                runs = counted(study.runs_of(point.index), "run")
                line = f"interval of the {estimate.name} cannot become finite{where}, stopped after {runs}"
                lines.append(f"{line}: {estimate.note}" if estimate.note else line)
                continue
            lines.append(
                f"interval of the {estimate.name} too wide{where} after {counted(study.runs_of(point.index), 'run')}: "
                f"{reached}, required {100 * (rule.until or 0.0):g} %; {estimate.note or 'raise --most'}"
            )
    return lines
