"""The verdict on a run or a study: whether people leave in time, and where the margin is least."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from typing_extensions import TypedDict

from evac.base.arrays import FloatArray

if TYPE_CHECKING:
    from evac.building.model.building import Level
    from evac.trajectory.trajectory import Trajectory

NO_LIMIT = "No limit set: a table [safety] in the case sets one"  #: What is said where no limit is set.

#: Criteria in words, by their keys in a case.
BY = {
    "available": "given",
    "visibility": "visibility",
    "temperature": "temperature",
    "fic": "irritants",
    "layer": "layer of smoke",
    "fed": "dose",
}


class Verdict(TypedDict):
    """Whether people leave in time, at the compartment whose margin with the safety factor is least.

    ``status`` is "green" if the required time with the safety factor is available, "amber" if it is without, "red" if
    it is not, and "none" without a limit. Times in s are null where there is no limit, and ``required`` and the margins
    also where people have not left. ``text`` says all that in a sentence.
    """

    status: Literal["green", "amber", "red", "none"]
    text: str
    compartment: str | None
    required: float | None
    available: float | None
    margin: float | None
    margin_with_factor: float | None


def verdict_of(safety: Mapping[str, Any] | None) -> Verdict:
    """Return the verdict on what summary.json has as ``safety``; a study has percentiles as required times."""
    rows = [] if safety is None else sorted(judged(safety), key=lambda row: row["margin_with_factor"])
    if safety is None or not rows:
        nobody = "No limit applies: nobody belongs to a compartment of the case"
        return Verdict(
            status="none",
            text=NO_LIMIT if safety is None else nobody,
            compartment=None,
            required=None,
            available=None,
            margin=None,
            margin_with_factor=None,
        )
    worst, factor = rows[0], safety["factor"]
    said = {"green": "In time", "amber": "In time, but not with the safety factor", "red": "NOT in time"}
    words = "no margin" if worst["required"] is None else f"margin {worst['margin']:.1f} s"
    if factor != 1.0 and worst["required"] is not None:
        words += f", {worst['margin_with_factor']:.1f} s with the factor {factor:g}"
    margins = (worst["margin"], worst["margin_with_factor"]) if worst["required"] is not None else (None, None)
    return Verdict(
        status=worst["status"],
        text=f"{said[worst['status']]}: {worst['text']}: {words}",
        compartment=worst["name"],
        required=worst["required"],
        available=worst["limit"],
        margin=margins[0],
        margin_with_factor=margins[1],
    )


def rank(verdict: Verdict) -> tuple[int, float]:
    """Return what orders verdicts, from the worst one; those without limits come first, because nothing is known."""
    margin = verdict["margin_with_factor"]
    return ["none", "red", "amber", "green"].index(verdict["status"]), -math.inf if margin is None else margin


def judged(safety: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the compartments to which people belong with ``status``, ``limit`` and ``margin``s [s], and a ``text``.

    The limit is the least available time that is known. The margins are -inf where people have not left.
    """
    for row in safety["compartments"]:
        if not row["people"]:
            continue
        limit, required = row["until"] if row["available"] is None else row["available"], row["required"]
        margins = [-math.inf if required is None else limit - factor * required for factor in (1.0, safety["factor"])]
        status = "green" if margins[1] >= 0.0 else "amber" if margins[0] >= 0.0 else "red"
        left = "not left by everybody" if required is None else f"left after {required:.1f} s{row.get('spread', '')}"
        how = "at least " * (row["available"] is None) + f"{limit:.1f} s"
        why = "" if row["available"] is None else f" ({BY[row['criterion']]})"
        text = f"{row['name']!r} is {left}, available for {how}{why}"
        yield {
            **row,
            "status": status,
            "limit": limit,
            "margin": margins[0],
            "margin_with_factor": margins[1],
            "text": text,
        }


def bars(safety: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Return what bars over time show of compartments: name, status, text, limit and required time; the worst first."""
    rows = [] if safety is None else sorted(judged(safety), key=lambda row: row["margin_with_factor"])
    return [{name: row[name] for name in ("name", "status", "text", "limit", "required")} for row in rows]


class LeastMargin(NamedTuple):
    """The least margin of a person on its way [s], when, and where: a level and a place in plan [m]."""

    person: int
    margin: float
    time: float
    level: "Level"
    x: float
    y: float


def least_margins(
    margins: Mapping[str, FloatArray], trajectory: "Trajectory", most: int | None = None
) -> list[LeastMargin]:
    """Return the least margins of people (`Results.margins`), worst first, with the last places recorded by then."""
    if not margins:
        return []
    least, at = margins["least_margin"], margins["least_margin_at"]
    worst_first = []
    for person in np.argsort(least, kind="stable")[: np.isfinite(least).sum()][:most].tolist():
        rows = trajectory.rows[max(int(np.searchsorted(trajectory.time, at[person] + 1e-9)) - 1, 0)]
        own = np.flatnonzero(rows.person == person)
        if len(own):  # who leaves soon after it came may be in no recorded state
            x, y = (rows.motion[own[0], :2].astype(np.float64) + trajectory.origin).tolist()
            level = trajectory.building.levels[rows.level[own[0]]]
            worst_first.append(LeastMargin(person, float(least[person]), float(at[person]), level, x, y))
    return worst_first
