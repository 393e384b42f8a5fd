"""Quality warnings: numerical or physical problems of a run, and how to fix them; remarks on its people."""

import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.analysis.hydraulic import ESCALATORS, LABORATORY, STAIRS
from evac.analysis.lines import LineFlow
from evac.analysis.queues import NEAR
from evac.base.arrays import FloatArray
from evac.base.change import Change, changes_in_words
from evac.base.errors import counted
from evac.building.model.building import FLAT, Building, Exit
from evac.contract.hooks import DEFAULT_MOVEMENT
from evac.directions.routes import QUICKEST
from evac.results.ending import CRUSHING_FORCE, CRUSHING_LOAD, DENSITY, DENSITY_SPAN, Observation

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.results.results import Results

#: Flow of an exit below which something is in its way while people queue [1/(m s)]; a queue is of so many people per
#: metre of width, close to the exit, and is judged after this time in total [s].
LEAST_FLOW = 0.5
QUEUE = 5
QUEUE_SPAN = 10.0

BESIDE = 0.5  #: Gap between bodies within which people at a place are in the way of somebody without progress [m].
MADE = 0.01  #: Net energy created by contacts is reported if it exceeds this share of the work of driving.


def noticed_of(
    case: "Case", building: Building, report: Mapping[str, Any], seen: Mapping[str, Observation]
) -> tuple[list[str] | None, tuple[str, ...]]:
    """Return the behaviours that keep distances, None if the case has one, and the quality warnings but for flows."""
    names = [level.title for level in building.levels]
    models, behaviours = case.registry.contact_models, case.registry.behaviours
    rigid = [name for name, model in models.items() if model.rigid and name != case.contact.model]
    keepers = [name for name, behaviour in behaviours.items() if behaviour.keeps_distance]
    keepers.sort(key=lambda name: name != DEFAULT_MOVEMENT)
    advised = None if case.keeps_distance else keepers
    return advised, (
        *(f"the building is incomplete: {one}" for one in building.findings if one.kind == "missing"),
        *contact_warnings(report, rigid, advised, seen.get("overlaps")),
        *([chatter_warning(seen["chatter"], names, rigid)] if "chatter" in seen else []),
        *([crushing_warning(seen["crushing"], names, advised)] if "crushing" in seen else []),
        *([density_warning(seen["dense"], names, advised)] if "dense" in seen else []),
    )


def contact_warnings(
    report: Mapping[str, Any],
    rigid: Sequence[str],
    keepers: Sequence[str] | None = None,
    overlaps: Observation | None = None,
) -> tuple[str, ...]:
    """Return a line for each number of a contact report (docs/summary.md) that is out of bounds.

    `rigid` names the registered contact models without overlaps and rebounds, see `ContactModel.rigid`. `keepers` names
    the registered behaviours that keep distances; None if one of them is in use. `overlaps` is what
    `Watch` has seen.
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
    """Return the quality warning on chattering contacts that `Watch` has seen; `rigid` as above."""
    velocity, displacement = seen.values
    return (
        "chattering contacts: evacuation times may be too short, because rebounding bodies loosen a jam; compare with a"
        f" contact model without rebounds{_models(rigid)}. {_who(seen, 'rebounded')}, most"
        f" {_where(seen, levels)}: displaced at {displacement:.2f} m/s, with contact velocities of"
        f" {velocity:.2f} m/s (docs/results.md)"
    )


def crushing_warning(seen: Observation, levels: Sequence[str], keepers: Sequence[str] | None) -> str:
    """Return the quality warning on lethal contact forces that `Watch` has seen; `keepers` as above."""
    force, load = seen.values
    advice = "" if keepers is None else f", or use a behaviour with which people keep their distance{_sets(keepers)}"
    return (
        "lethal contact forces: such a crowd would be crushed, and injuries are not modelled; widen the passage or "
        f"reduce the number of people{advice}. {_who(seen, 'exceeded')} {CRUSHING_LOAD / 1000:g} kN per metre of "
        f"body width or {CRUSHING_FORCE / 1000:g} kN, most {_where(seen, levels)}: {load / 1000:.1f} kN/m, "
        f"{force / 1000:.1f} kN (docs/results.md)"
    )


def density_warning(seen: Observation, levels: Sequence[str], keepers: Sequence[str] | None) -> str:
    """Return the quality warning on crowds that `Watch` has seen; `keepers` as above."""
    advice = "" if keepers is None else f" use a behaviour with which people keep their distance{_sets(keepers)},"
    return (
        f"dangerous density: crowds above {DENSITY:g} people per square metre are in danger of their lives;{advice} "
        f"widen the passage, or reduce the number of people. {_who(seen, 'stood')} for {DENSITY_SPAN:g} s among more "
        f"than {DENSITY:g} people per square metre, most {_where(seen, levels)}: {seen.values[0]:.1f} (docs/results.md)"
    )


#: What states each limit of a flow.
SOURCES = {LABORATORY: "experiments", STAIRS: "design guides", ESCALATORS: "EN 115-1"}


def flow_warnings(
    building: Building, changes: Iterable[Change], flows: Iterable[LineFlow], keepers: Sequence[str] | None
) -> tuple[str, ...]:
    """Return a line for each exit, door, stair and portal with a flow higher than measured; `keepers` as above.

    The flow is that in one direction of people who pass for the first time; of a stair, the greatest of its ends. A
    stair is an escalator if its ground moves at the end, in `building`, or has been started or stopped by `changes`.
    """
    moved = {change.what for change in changes if change.kind == "move"}
    advice = "check in flows.csv whether they passed within a short time"
    if keepers is not None:
        advice = f"use a behaviour with which people keep their distance{_sets(keepers)}"
    greatest = dict[str, tuple[float, float]]()
    for line in (one for one in flows if one.kind != "line"):
        levels = (building.levels[level] for level in line.levels)
        stair = next((level.stair for level in levels if level.stair and not level.is_ramp), None)
        what = f"{line.kind} {line.name!r}" if stair is None else f"stair {stair!r}"
        is_moving = stair in moved or not {level for level, _, _ in building.moving}.isdisjoint(line.levels)
        limit = LABORATORY if stair is None else ESCALATORS if is_moving else STAIRS
        for way in (line.forward, ~line.forward):
            _, first = np.unique(line.person[way], return_index=True)
            is_new = np.zeros(len(way), np.bool_)
            is_new[np.flatnonzero(way)[first]] = True
            flow = (line.flow_of(is_new) or 0.0) / line.width
            if flow > limit:
                greatest[what] = max(greatest.get(what, (flow, limit)), (flow, limit))
    return tuple(
        f"flow higher than measured: evacuation times may be too short; {advice}. "
        f"{flow:.2f} people per second and metre passed {what}, at most {limit} in "
        f"{SOURCES[limit]}"
        for what, (flow, limit) in greatest.items()
    )


def queue_warnings(results: "Results") -> tuple[str, ...]:
    """Return a line for each open exit without control that few left by while others waited close to it."""
    lines, queues = [], {queue.name: queue for queue in results.queues if queue.kind == "exit"}
    trajectory = results.trajectory
    for exit_ in results.building.exits:
        queue = queues.get(exit_.name)
        if queue is None or trajectory is None:
            continue
        time = trajectory.time
        queued = np.flatnonzero(queue.near >= QUEUE * max(1.0, exit_.width))
        then = [trajectory.building_at(at) for at in time[queued].tolist()]
        queued = queued[[at.is_open(exit_) and at.link_of(exit_) not in at.controlled for at in then]]
        seconds = float(np.diff(time, prepend=time[0])[queued].sum())
        left = results.crowd.exit_time[results.crowd.exit_used == exit_.index]
        flow = np.isin(np.searchsorted(time, left), queued).sum() / max(seconds, QUEUE_SPAN) / exit_.width
        if seconds >= QUEUE_SPAN and flow < LEAST_FLOW:
            lines.append(
                "flow lower than measured: evacuation times may be too long; look in the replay at who stands in the "
                f"doorway, for example before a response time is over. {flow:.2f} people per second and metre left by "
                f"exit {exit_.name!r} in {seconds:.1f} s between {time[queued[0]]:.1f} and {time[queued[-1]]:.1f} s in "
                f"which {QUEUE} or more per metre waited within {NEAR:g} m of it; {LEAST_FLOW} is little for a queue"
            )
    return tuple(lines)


def _idle_exits(results: "Results") -> Iterator[str]:
    """Yield a line for each open exit that nobody left by while people who may take it queued at another one nearby."""
    # They could have walked straight to it in the time for which it was idle, and did not choose exits by the queues.
    if results.trajectory is None:
        return
    crowd, exits, told = results.crowd, {one.name: one for one in results.building.exits}, set[str]()
    for queue in (one for one in results.queues if one.kind == "exit" and not one.is_little):
        own = exits[queue.name]
        queued = crowd.exit_used == own.index
        routes = [results.routes[k] for k in np.unique(crowd.route[queued]).tolist()]
        for other in (one for one in exits.values() if one.level == own.level and one is not own):
            left = crowd.exit_time[crowd.exit_used == other.index]
            since = max(queue.start, left[left < queue.end].max(initial=0.0))
            away = float(np.hypot(*(_middle(other) - _middle(own))))
            is_open = all(results.trajectory.building_at(time).is_open(other) for time in (since, queue.end))
            chosen = any(route.leads_to(other.name) and route.strategy != QUICKEST for route in routes)
            idle = queue.end - since
            if chosen and is_open and other.name not in told and idle * crowd.speed[queued, FLAT].mean() > away:
                told.add(other.name)
                yield (
                    f"Nobody left by exit {other.name!r} from {since:.1f} to {queue.end:.1f} s while people queued at "
                    f'exit {own.name!r}, {away:.1f} m away: with strategy = "{QUICKEST}", they choose by the queues'
                )


def _middle(exit_: Exit) -> FloatArray:
    """Return the mean of the ends of the segments of an exit (2,) [m]."""
    middle: FloatArray = exit_.segments.reshape(-1, 2).mean(axis=0)
    return middle


def _models(names: Sequence[str]) -> str:
    return _options([f"contact.model={name}" for name in names])


def _sets(behaviours: Sequence[str]) -> str:
    return _options([f"behaviours.{name}={{}}" for name in behaviours])


def _options(settings: Sequence[str]) -> str:
    return f" (set {' or '.join(settings)})" if settings else ""


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
    """Return a line for each kind of people who did not leave by their route, idle exits, and notes of behaviours."""
    people, level = results.number_of_people, results.crowd.level
    leaving = np.setdiff1d(results.leaving, results.stopped)
    inside = leaving[level[leaving] >= 0]
    lines = []
    for place in (one for one in results.places if one.people):
        room = "" if place.capacity is None else f", which has room for {place.capacity}"
        lines.append(f"{_number(len(place.people))} at {place}{room}")
    lines = ["; ".join(lines)] if lines else []  # one line, of which an answer shows all places or none
    if left := len(inside):
        number = Counter(results.titles_at(inside[np.argsort(level[inside], kind="stable")].tolist()))
        where = ", ".join(f"{people_there} on {name!r}" for name, people_there in number.items())
        waiting = results.not_started
        wait = f"; {waiting} of them had not started, because their response time was not over" if waiting else ""
        lines.append(f"{_number(left)} still inside: {where}{wait}")
    if late := results.not_arrived - results.spare:
        outside = f"; {results.waiting_outside} of them found no free place" if results.waiting_outside else ""
        lines.append(f"{_number(late)} of {people} had not entered the building at the end{outside}")
    if fallen := len(results.stopped):
        first = min(results.exposure["stopped_at"][results.stopped].tolist())
        lines.append(f"{_number(fallen)} stopped by gases or heat, the first at {first:.1f} s; they are still inside")
    dose = (results.conditions or {}).get("dose")
    if dose and (growing := dose["growing"]):
        lines.append(
            f"{_number(growing)} inside still took a dose of gases or heat when the run ended, because its duration or "
            "the data ended: a longer simulation.duration, or hold = true, shows whether they are stopped"
        )
    irritants = results.exposure.get("greatest_irritants", np.zeros(0))
    if severe := int((irritants >= 1.0).sum()):
        lines.append(
            f"{_number(severe)} in irritants of at least the concentration of incapacitation, up to "
            f"{irritants.max():.2g} times it: they are slowed, not stopped"
        )
    if results.staying:
        lines.append(f"{_number(results.staying)} inside did not leave (leave = false)")
    for name, entered in results.entered_barred.items():
        lines.append(f"{_number(len(entered))} entered {name!r} while it was barred, because they had no other way")
    if pushed := len(results.left_by_other_exits):
        lines.append(f"{_number(pushed)} left by an exit outside their route: their exit closed, or they were pushed")
    lines += _idle_exits(results)
    return (*lines, *_without_progress(results), *results.notes)


def _without_progress(results: "Results") -> Iterator[str]:
    """Yield a line on the people who had made no progress at the end, with what may hold them up."""
    if not results.stuck:
        return
    first = results.stuck[0]
    x, y = results.crowd.position[first]
    why = "nobody touches them: check whether a behaviour holds them back, and the directions there"
    if (results.crowd.contact_force[list(results.stuck)] > 0.0).any():
        why = (
            "bodies in contact can block a narrow passage permanently, because people do not turn or give way; "
            "compare several seeds, or a wider passage"
        )
    if beside := [place for place in results.places if _are_near(results, first, place.people)]:
        why = f"people at {beside[0]} stand in the way: draw its area beside the ways of others, or larger"
    if closed := closings(results.changes):
        why = f"what is closed may hold them up: {'; '.join(closed)}"
    yield (
        f"{_number(len(results.stuck))} without progress at the end, the first at ({x:.2f}, {y:.2f}) on "
        f"{results.titles_at([first])[0]!r}: {why}"
    )


def _are_near(results: "Results", person: int, others: Sequence[int]) -> bool:
    """Return whether one of some other people inside is within `BESIDE` of the body of a person."""
    crowd, rows = results.crowd, np.array(others, np.int64)
    rows = rows[crowd.level[rows] == crowd.level[person]]
    gaps = np.hypot(*(crowd.position[rows] - crowd.position[person]).T) - crowd.radius[rows] - crowd.radius[person]
    return bool((gaps < BESIDE).any())


def closings(changes: Iterable[Change]) -> list[str]:
    """Return the changes that have closed something, or closed it to those who would enter, and are still in force."""
    closed = dict[str, Change]()
    for change in changes:
        if change.kind in ("open", "close", "no_entry"):
            closed.pop(change.what, None)
        if change.kind in ("close", "no_entry") and change.values.get("value") is not False:
            closed[change.what] = change
    return [f"{words} at {time:g} s" for time, words in changes_in_words(closed.values())]


def _number(number: int) -> str:
    return counted(number, "person", "people")
