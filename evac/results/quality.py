"""Quality warnings: numerical or physical problems of a run, and how to fix them; remarks on its people."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from evac.analysis.hydraulic import LABORATORY
from evac.base.errors import counted
from evac.results.watch import CRUSHING_FORCE, CRUSHING_LOAD, Observation

if TYPE_CHECKING:
    from evac.results.results import Results

#: Net energy created by contacts is reported if it exceeds this share of the work of driving.
MADE = 0.01


def contact_warnings(
    report: Mapping[str, Any],
    rigid: Sequence[str],
    keepers: Sequence[str] | None = None,
    overlaps: Observation | None = None,
) -> tuple[str, ...]:
    """Return a line for each number of a contact report (docs/summary.md) that is out of bounds.

    `rigid` names the registered contact models without overlaps and rebounds, see `ContactModel.rigid`. `keepers` names
    the registered behaviours that keep distances; None if one of them is in use. `overlaps` is what
    `Watch.overlaps` has seen.
    """
    warnings = []
    overlap, promised, energy = report["greatest_overlap"], report["promised_overlap"], report["energy"]
    if overlap > promised:
        at, model = report["greatest_overlap_at"], report["model"]
        who = _who(overlaps, "overlapped") if overlaps else "Bodies overlapped"
        advice = "" if keepers is None else f"a behaviour with which people keep their distance{_sets(keepers)}, "
        stiffer = f"a greater contact.{model}.stiffness with a " if "stiffness" in report["parameters"] else "a "
        warnings.append(
            f"large overlaps: positions and forces there are not reliable; use {advice}{stiffer}smaller "
            "simulation.step, start positions without overlaps, or a contact model that prevents overlaps"
            f"{_models(rigid)}. {who} by more than the {_length(promised)} that contact model {model!r} guarantees, "
            f"most at t = {at['time']:.2f} s, person {at['person']} at ({at['x']:.2f}, {at['y']:.2f}) on level "
            f"{at['level']!r}: {_length(overlap)} (docs/results.md)"
        )
    unconverged = report["unconverged_steps"]
    if unconverged:
        warnings.append(
            f"in {unconverged} of {report['steps']} steps contacts were not solved to the tolerance, with residuals up "
            f"to {report['greatest_residual']:.2g} m/s; use a smaller simulation.step, or more iterations"
        )
    if report["failed_solves"]:
        solver, at = report["parameters"]["solver"], report["failed_solver"]
        file, _, _ = at.rpartition(", line ")
        warnings.append(
            f"solver {solver!r} failed {counted(report['failed_solves'], 'time')}: its percussions were not finite, or"
            f" missed the tolerance although it stated a smaller residual ({at}); a stronger solver was used instead;"
            f" correct it, and check it with: evac plugins --check {shlex.quote(file)}"
        )
    failed = report["failed_position_corrections"]
    if failed:
        warnings.append(
            f"overlaps could not be removed {failed} times, for example of a squeezed body; check for places that are "
            "too narrow, and for people who overlap at the start"
        )
    made, taken = energy["contact_creation"], energy["contact_dissipation"]
    if made > taken and made - taken > MADE * energy["driving_work"]:
        warnings.append(
            f"contacts created {made:.4g} J, more than the {taken:.4g} J that they dissipated; use a smaller "
            "simulation.step"
        )
    return tuple(warnings)


def chatter_warning(seen: Observation, levels: Sequence[str], rigid: Sequence[str]) -> str:
    """Return the quality warning on chattering contacts that `Watch.chatter` has seen; `rigid` as above."""
    velocity, displacement = seen.values
    return (
        "chattering contacts: evacuation times may be too short, because rebounding bodies loosen a jam; compare with a"
        f" contact model without rebounds{_models(rigid)}. {_who(seen, 'rebounded')}, most"
        f" {_where(seen, levels)}: displaced at {displacement:.2f} m/s, with contact velocities of"
        f" {velocity:.2f} m/s (docs/results.md)"
    )


def crushing_warning(seen: Observation, levels: Sequence[str], keepers: Sequence[str] | None) -> str:
    """Return the quality warning on lethal contact forces that `Watch.crushing` has seen.

    `keepers` as above.
    """
    force, load = seen.values
    advice = "" if keepers is None else f", or use a behaviour with which people keep their distance{_sets(keepers)}"
    return (
        "lethal contact forces: such a crowd would be crushed, and injuries are not modelled; widen the passage or "
        f"reduce the number of people{advice}. {_who(seen, 'exceeded')} {CRUSHING_LOAD / 1000:g} kN per metre of "
        f"body width or {CRUSHING_FORCE / 1000:g} kN, most {_where(seen, levels)}: {load / 1000:.1f} kN/m, "
        f"{force / 1000:.1f} kN (docs/results.md)"
    )


def flow_warnings(exits: Mapping[str, Mapping[str, Any]], keepers: Sequence[str] | None) -> tuple[str, ...]:
    """Return a line for each exit of `exit_table` whose specific flow is higher than measured; `keepers` as above."""
    advice = "check in egress.csv whether they left within a short time"
    if keepers is not None:
        advice = f"use a behaviour with which people keep their distance{_sets(keepers)}"
    return tuple(
        f"flow higher than measured: evacuation times may be too short; {advice}. "
        f"{use['flow_per_metre']:.2f} people per second and metre left by {name!r}, at most {LABORATORY} in experiments"
        for name, use in exits.items()
        if (use["flow_per_metre"] or 0.0) > LABORATORY
    )


def _models(names: Sequence[str]) -> str:
    return _options([f"contact.model={name}" for name in names])


def _sets(behaviours: Sequence[str]) -> str:
    return _options([f"behaviours.{name}={{}}" for name in behaviours])


def _options(settings: Sequence[str]) -> str:
    return f" (--set {' or '.join(settings)})" if settings else ""


def _length(metres: float) -> str:
    return f"{1000.0 * metres:.3g} mm"


def _who(seen: Observation, did: str) -> str:
    people = counted(seen.people, "person", "people")
    return f"Between t = {seen.since:.1f} and {seen.until:.1f} s {people} {did}"


def _where(seen: Observation, levels: Sequence[str]) -> str:
    return (
        f"from {seen.begin:.1f} to {seen.end:.1f} s, person {seen.person} at ({seen.x:.2f}, "
        f"{seen.y:.2f}) on level {levels[seen.level]!r}"
    )


def remarks_of(results: "Results") -> tuple[str, ...]:
    """Return a line for each kind of people who did not leave by their route, and the notes of behaviours."""
    people, level, names = results.number_of_people, results.crowd.level, list(results.levels)
    stopped = set(results.stopped.tolist())
    leaving = level[[row for row in results.leaving.tolist() if row not in stopped]]
    lines = []
    for place in (one for one in results.places if one.people):
        room = "" if place.capacity is None else f", which has room for {place.capacity}"
        lines.append(f"{_number(len(place.people))} at {place}{room}")
    lines = ["; ".join(lines)] if lines else []  # one line, of which an answer shows all places or none
    if left := int((leaving >= 0).sum()):
        number = Counter(leaving[leaving >= 0].tolist())
        where = ", ".join(f"{number[index]} on {names[index]!r}" for index in sorted(number))
        waiting = results.not_started
        wait = f"; {waiting} of them had not started, because their response time was not over" if waiting else ""
        lines.append(f"{_number(left)} still inside: {where}{wait}")
    if late := results.not_arrived:
        outside = f"; {results.waiting_outside} of them found no free place" if results.waiting_outside else ""
        lines.append(f"{_number(late)} of {people} had not entered the building at the end{outside}")
    if fallen := len(results.stopped):
        first = min(results.exposure["stopped_at"][results.stopped].tolist())
        lines.append(f"{_number(fallen)} stopped by gases or heat, the first at {first:.1f} s; they are still inside")
    if results.staying:
        lines.append(f"{_number(results.staying)} inside did not leave (leave = false)")
    for name, entered in results.entered_barred.items():
        lines.append(f"{_number(len(entered))} entered {name!r} while it was barred, because they had no other way")
    if pushed := len(results.left_by_other_exits):
        lines.append(f"{_number(pushed)} left by an exit outside their route: their exit closed, or they were pushed")
    if results.stuck:
        first = results.stuck[0]
        x, y = results.crowd.position[first]
        why = "nobody touches them: check whether a behaviour holds them back, and the directions there"
        if (results.crowd.contact_force[list(results.stuck)] > 0.0).any():
            why = (
                "bodies in contact can block a narrow passage permanently, because people do not turn or give way; "
                "compare several seeds, or a wider passage"
            )
        lines.append(
            f"{_number(len(results.stuck))} without progress at the end, the first at ({x:.2f}, {y:.2f}) on "
            f"{names[level[first]]!r}: {why}"
        )
    return (*lines, *results.notes)


def _number(number: int) -> str:
    return counted(number, "person", "people")
