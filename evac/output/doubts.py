"""What the numbers of a run say against it: legal, and reported, but more than a look at the table may notice."""

from collections.abc import Mapping
from typing import Any

#: An overlap beyond this share of the smallest radius is no contact any more: people pass through one another.
DEEP = 0.5

#: The greatest flow that laboratories have measured through bottlenecks: Daamen and Hoogendoorn (2010) [1/s/m].
MEASURED = 2.8

#: Energy made by contacts beyond what they took is noticed where it is more than this share of the work of driving.
MADE = 0.01


def doubts_about(report: Mapping[str, Any], smallest_radius: float) -> tuple[str, ...]:
    """Return a line for each number of a run's contact report that speaks against it, with the way out.

    Parameters
    ----------
    report : mapping
        Of the contact model, see docs/results.md.
    smallest_radius : float [m]

    Returns
    -------
    tuple of str
    """
    found = []
    overlap, energy = report["greatest_overlap"], report["energy"]
    if overlap > DEEP * smallest_radius:
        found.append(
            f"bodies overlapped by up to {overlap:.2f} m, the smallest radius being {smallest_radius:.2f} m: use a "
            "smaller simulation.step or stiffer contacts; 'nsm1' keeps people apart who do not start in one another"
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
            f"overlaps could not be parted {failed} times, as where a body is squeezed: look for a place too narrow, "
            "or for people who start in one another"
        )
    made, taken = energy["contact_creation"], energy["contact_dissipation"]
    if made > taken and made - taken > MADE * energy["driving_work"]:
        found.append(
            f"contacts made {made:.4g} J, more than the {taken:.4g} J that they took: people are thrown about; use a "
            "smaller simulation.step"
        )
    return tuple(found)


def doubts_about_flows(exits: Mapping[str, Mapping[str, Any]], keeps_distance: bool) -> tuple[str, ...]:
    """Return a line for each exit that people left faster than they do in any laboratory, with the way out.

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
