"""The verdict table at the head of every evidence page: question, measured, wanted, verdict.

Each function returns one row. A verdict is "met", "not met" with the deviation, "undecided" if an interval contains
the bound, or "reported only" if there is no target.
"""

import math
import re
from collections.abc import Sequence

#: A row: question, measured, wanted, verdict, and the heading of the section that has the details.
Finding = dict[str, str]

MET, NOT_MET, REPORTED = "met", "not met", "reported only"
UNDECIDED = "undecided: the interval contains the bound"

#: Maximum number of rows of a table, which must fit on one screen.
MOST_ROWS = 20


def at_most(question: str, measured: float | None, bound: float, unit: str = "", section: str = "") -> Finding:
    """Return the row of a quantity that must not exceed a bound; None or NaN if it was not measured."""
    return _bounded(question, measured, bound, unit, section, "at most")


def at_least(question: str, measured: float | None, bound: float, unit: str = "", section: str = "") -> Finding:
    """Return the row of a quantity that must reach a bound; None or NaN if it was not measured."""
    return _bounded(question, measured, bound, unit, section, "at least")


def surely_at_most(
    question: str, value: float, half: float, bound: float, unit: str = "", section: str = ""
) -> Finding:
    """Return the row of a magnitude that must not exceed a bound, with half the width of its confidence interval."""
    verdict = UNDECIDED
    if abs(value) + half <= bound:
        verdict = MET
    elif abs(value) - half > bound:
        verdict = f"{NOT_MET}: {abs(value) / bound:.3g} times the bound"
    return _finding(question, f"{value:+.1f} ± {half:.1f} {unit}", f"at most {_told(bound, unit)}", verdict, section)


def all_of(question: str, count: int, total: int, section: str = "") -> Finding:
    """Return the row of a property that must hold in all of `total` cases and holds in `count`."""
    verdict = MET if count == total > 0 else f"{NOT_MET} in {total - count}" if total else f"{NOT_MET}: no case"
    return _finding(question, f"{count} of {total}", "all", verdict, section)


def within(
    question: str, measured: float, low: float, high: float, reference: float, unit: str = "", section: str = ""
) -> Finding:
    """Return the row of a reference that must lie in the confidence interval of a measured quantity."""
    verdict = MET if low <= reference <= high else f"{NOT_MET}: {100.0 * (measured / reference - 1.0):+.0f} %"
    text = f"{_told(measured, unit)} ({low:.4g} to {high:.4g})"
    return _finding(question, text, f"{_told(reference, unit)} in the interval", verdict, section)


def reported(question: str, measured: str, reference: str = "-", section: str = "") -> Finding:
    """Return the row of a quantity without a target."""
    return _finding(question, measured, reference, REPORTED, section)


def verdict_table(findings: Sequence[Finding], page: str = "") -> str:
    """Return the rows as a Markdown table; questions link to their sections on `page`, this one if it is empty."""
    lines = ["| question | measured | wanted | verdict |", "|---|---|---|---|"]
    for row in findings:
        question = row["question"].replace("|", "\\|")
        if row["section"]:
            question = f"[{question}]({page}#{anchor(row['section'])})"
        lines.append(f"| {question} | {row['measured']} | {row['wanted']} | {row['verdict']} |")
    return "\n".join(lines)


def anchor(heading: str) -> str:
    """Return the anchor of a heading on GitHub."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _bounded(question: str, measured: float | None, bound: float, unit: str, section: str, side: str) -> Finding:
    wanted = f"{side} {_told(bound, unit)}"
    if measured is None or math.isnan(measured):
        return _finding(question, "-", wanted, f"{NOT_MET}: no measurement", section)
    is_met = measured <= bound if side == "at most" else measured >= bound
    missed = f"{measured / bound:.3g} times the bound" if bound else f"{measured:.3g} beyond the bound"
    return _finding(question, _told(measured, unit), wanted, MET if is_met else f"{NOT_MET}: {missed}", section)


def _told(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".strip()


def _finding(question: str, measured: str, wanted: str, verdict: str, section: str) -> Finding:
    return {"question": question, "measured": measured, "wanted": wanted, "verdict": verdict, "section": section}
