"""Quality warnings: numerical or physical problems of a run, one line each, with how to fix them."""

from collections.abc import Mapping, Sequence
from typing import Any

from evac.output.watch import CRUSHING_FORCE, CRUSHING_LOAD, Finding

#: The greatest flow that laboratories have measured through bottlenecks: Daamen and Hoogendoorn (2010) [1/s/m].
MEASURED = 2.8

#: Energy made by contacts beyond what they took is noticed where it is more than this share of the work of driving.
MADE = 0.01


def contact_warnings(report: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a warning for each number of a run's contact report that is out of bounds.

    Parameters
    ----------
    report : mapping
        Of the contact model, see docs/results.md.

    Returns
    -------
    tuple of str
    """
    found = []
    overlap, promised, energy = report["greatest_overlap"], report["promised_overlap"], report["energy"]
    if overlap > promised:
        at = report["greatest_overlap_at"]
        found.append(
            f"bodies overlapped by up to {_length(overlap)}, where contact model {report['model']!r} promises at most "
            f"{_length(promised)}: greatest at t = {at['time']:.2f} s, of person {at['person']} at ({at['x']:.2f}, "
            f"{at['y']:.2f}) on level {at['level']!r}; use a smaller simulation.step or stiffer contacts, and start "
            "nobody in another; 'nsm1' keeps people apart who do not start in one another"
        )
    unconverged = report["unconverged_steps"]
    if unconverged:
        found.append(
            f"in {unconverged} of {report['steps']} steps contacts were not solved to the tolerance, the worst to "
            f"{report['greatest_residual']:.2g} m/s: use a smaller simulation.step, or more iterations"
        )
    failed = report["failed_position_corrections"]
    if failed:
        found.append(
            f"overlaps could not be removed {failed} times, as where a body is squeezed: look for a place too narrow, "
            "or for people who start in one another"
        )
    made, taken = energy["contact_creation"], energy["contact_dissipation"]
    if made > taken and made - taken > MADE * energy["driving_work"]:
        found.append(
            f"contacts made {made:.4g} J, more than the {taken:.4g} J that they took: people are thrown about; use a "
            "smaller simulation.step"
        )
    return tuple(found)


def chatter_warning(finding: Finding, levels: Sequence[str]) -> str:
    """Return the line about contacts that chatter.

    Parameters
    ----------
    finding : Finding
        As `evac.output.watch.Watch.chatter` returns it.
    levels : sequence of str
        Names of the levels.
    """
    velocity, displacement = finding.values
    return (
        f"contacts chatter: {_who(finding)} displaced much more slowly than the contact model's velocities say; most "
        f"{_where(finding, levels)}: {displacement:.2f} m/s, where they say {velocity:.2f} m/s. Recorded speeds are "
        "displacements, but bodies that bounce loosen a jam; use contacts with less restitution ('nsm1' has none), and "
        "compare"
    )


def crushing_warning(finding: Finding, levels: Sequence[str], keeps_distance: bool) -> str:
    """Return the line about contact forces that nobody survives.

    Parameters
    ----------
    finding : Finding
        As `evac.output.watch.Watch.crushing` returns it.
    levels : sequence of str
        Names of the levels.
    keeps_distance : bool
        Whether the behaviour headway is in use.
    """
    force, load = finding.values
    advice = "" if keeps_distance else "; with [behaviours.headway] they keep their distance"
    return (
        f"contact forces that nobody survives: {_who(finding)} pressed with more than {CRUSHING_LOAD / 1000:g} kN per "
        f"metre of body width or {CRUSHING_FORCE / 1000:g} kN; most {_where(finding, levels)}: {load / 1000:.1f} kN/m, "
        f"{force / 1000:.1f} kN. No harm is computed: the people of this model push without end{advice}"
    )


def flow_warnings(exits: Mapping[str, Mapping[str, Any]], keeps_distance: bool) -> tuple[str, ...]:
    """Return a line for each exit that people left faster than they do in any laboratory.

    Parameters
    ----------
    exits : mapping
        As `evac.output.flows.exit_table` returns it.
    keeps_distance : bool
        Whether the behaviour headway is in use.

    Returns
    -------
    tuple of str
    """
    why = "they are pushed out; with [behaviours.headway] people keep their distance"
    if keeps_distance:
        why = "look at egress.csv whether they left in one short rush"
    return tuple(
        f"{use['flow_per_metre']:.2f} people per second and metre left by {name!r}, more than the {MEASURED} that "
        f"laboratories have measured: {why}"
        for name, use in exits.items()
        if (use["flow_per_metre"] or 0.0) > MEASURED
    )


def _length(metres: float) -> str:
    return f"{1000.0 * metres:.3g} mm"


def _who(finding: Finding) -> str:
    people = "1 person was" if finding.people == 1 else f"{finding.people} people were"
    return f"between t = {finding.since:.1f} and {finding.until:.1f} s {people}"


def _where(finding: Finding, levels: Sequence[str]) -> str:
    return (
        f"from {finding.begin:.1f} to {finding.end:.1f} s, person {finding.person} at ({finding.x:.2f}, "
        f"{finding.y:.2f}) on level {levels[finding.level]!r}"
    )
