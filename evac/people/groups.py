"""Requirements of the groups of a case: areas, levels and exits, routes and reference speeds."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from evac.base.arrays import FloatArray, IndexArray
from evac.base.defaults import LEAST_RADIUS
from evac.base.distributions import Distribution
from evac.base.errors import ScenarioError, counted, fault, plugin_code
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building
from evac.building.model.links import ways_onto
from evac.directions.routes import Route
from evac.people.behaviour import Behaviour
from evac.physics.extent import extent, greatest_extent
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import GroupSettings
    from evac.people.population import Group


def route_of(people: "GroupSettings") -> Route:
    """Return the initial route of a group."""
    return Route(people.exits, people.strategy, people.steepest, lifts=people.lifts or "")


def routes_of(case: "Case") -> tuple[Route, ...]:
    """Return the distinct routes of all groups, in the order of the groups."""
    return tuple(dict.fromkeys(route_of(people) for people in case.people))


def default_clearance(case: "Case", behaviours: Sequence[Behaviour] = ()) -> float:
    """Return the default clearance of directions from walls: the largest contact radius, at most twice the mean [m]."""
    greatest = max(_contact_radius(behaviours, people, people.radius.support()[1]) for people in case.people)
    mean = max(_contact_radius(behaviours, people, people.radius.mean()) for people in case.people)
    return min(greatest, 2.0 * mean)


def narrowest_body(case: "Case", behaviours: Sequence[Behaviour] = ()) -> float:
    """Return the smallest possible diameter of a body that fits through gaps [m]; arguments as `default_clearance`."""
    return 2.0 * min(_contact_radius(behaviours, people, people.radius.support()[0]) for people in case.people)


def contact_radii(behaviours: Sequence[Behaviour], people: "GroupSettings", radius: FloatArray) -> FloatArray:
    """Return the contact radii of people of a group: if they turn the smallest that a behaviour states, or theirs."""
    smallest = radius
    for behaviour in behaviours if people.turns else ():
        what = f"behaviour {behaviour.name!r}: contact_radius"
        with plugin_code(what, behaviour):
            own = people.behaviours.get(behaviour.name, {})
            stated = np.asarray(behaviour.contact_radius(radius.copy(), own), np.float64)
        if stated.shape != radius.shape or not ((stated >= LEAST_RADIUS) & (stated <= radius)).all():
            wrong = f"returned {stated!r} for the radii {radius!r} of group {people.name!r}"
            remedy = f"return an array of as many numbers, at least {LEAST_RADIUS:g} and at most these"
            raise fault(what, wrong, remedy, behaviour)
        smallest = np.minimum(smallest, stated)
    return smallest


def _contact_radius(behaviours: Sequence[Behaviour], people: "GroupSettings", radius: float) -> float:
    return float(contact_radii(behaviours, people, np.array([radius]))[0])


def reference_speeds(case: "Case") -> tuple[float, float, float]:
    """Return the reference speeds (flat, up, down) for travel times, relative to the speed on the flat.

    By default, ``directions.stairs_up`` and ``stairs_down`` are the ratios of the people's mean speeds on stairs to
    their mean speed on the flat.
    """
    flat = math.fsum(people.count * people.speed.mean() for people in case.people)
    factors = []
    for key, quantity in (("stairs_up", "speed_up"), ("stairs_down", "speed_down")):
        given = getattr(case.directions, key)
        if given is None:
            means = (people.count * _mean_on_stairs(people, quantity) for people in case.people)
            total = math.fsum(means)
            if flat <= 0:
                factors.append(1.0)  # nobody walks, so any value will do
                continue
            if total <= 0:
                raise ScenarioError(
                    f"{case.source}: directions.{key}: it has no default because the mean of people's {quantity} is 0; "
                    f"set directions.{key}"
                )
            given = total / flat
        factors.append(given)
    return 1.0, factors[0], factors[1]


def check_people(case: "Case", building: Building) -> None:
    """Check the names that groups use against the building."""
    areas = [area.name for area in building.areas]
    is_shut = {exit_.name for exit_ in building.exits if not building.is_open(exit_)}
    problems: list[str] = []
    for people in case.people:
        key = f"{case.source}: people.{people.name}"
        if people.area is not None and areas.count(people.area) != 1:
            if people.area in areas:
                problems.append(f"{key}.area: {areas.count(people.area)} areas are named {people.area!r}; rename them")
            else:
                hint = did_you_mean(people.area, areas) if areas else "there are no areas: add one to building.areas"
                problems.append(f"{key}.area: unknown area {people.area!r}; {hint}")
        is_anywhere = people.positions is None and people.arrive is None  # also on a whole stair
        of_stair = building.pieces_of(people.level or "") if is_anywhere else ()
        if people.level is not None and building.level_named(people.level) is None and not of_stair:
            levels = [*dict.fromkeys(level.title if is_anywhere else level.name for level in building.levels)]
            problems.append(f"{key}.level: unknown level {people.level!r}; {did_you_mean(people.level, levels)}")
        exits = [exit_.name for exit_ in building.exits]
        for name in people.exits:
            if name not in exits:
                problems.append(f"{key}.exits: unknown exit {name!r}; {did_you_mean(name, exits)}")
        if people.arrive is not None and people.arrive.exit not in (None, *exits):
            name = str(people.arrive.exit)
            problems.append(f"{key}.arrive.exit: unknown exit {name!r}; {did_you_mean(name, exits)}")
        if people.arrive is not None and people.arrive.portal is not None:
            name, level = people.arrive.portal, building.level_named(people.level or "")
            if level is not None and name not in (known := ways_onto(building, level.index)):
                hint = did_you_mean(name, [*known])
                problems.append(f"{key}.arrive.portal: no portal or stair {name!r} leads onto {level.name!r}; {hint}")
        if people.exits and is_shut.issuperset(people.exits):
            which = " or ".join(map(repr, people.exits))
            problems.append(f"{key}.exits: leads only to {which}, which building.closed closes; add another exit")
    if problems:
        raise ScenarioError("\n".join(problems))


def opens_later(case: "Case") -> bool:
    """Return whether an event of a case may open a way that people have to wait for."""
    return any(event.kind in ("open", "strategy") or event.value is False for event in case.event)


def _mean_on_stairs(people: "GroupSettings", quantity: str) -> float:
    """Return the mean speed of a group on stairs; a factor is independent of the flat speed that it multiplies."""
    given, flat = getattr(people, quantity), people.speed.mean()
    mean = given.mean() if isinstance(given, Distribution) else float(given.factor.mean() * flat)
    return min(mean, flat) if people.limit_stair_speeds else mean


#: Quantities with their units and usual ranges for people.
USUAL = (
    ("speed", "m/s", 0.1, 3.0),
    ("radius", "m", 0.1, 0.5),
    ("height", "m", 0.7, 2.3),
    ("mass", "kg", 10.0, 200.0),
    ("tau", "s", 0.01, 2.0),
)

ROUNDING = 1e-6  #: Initial overlaps below this are taken as rounding errors [m].


def unusual(crowd: Crowd, groups: "Sequence[Group]") -> tuple[str, ...]:
    """Return a warning for each quantity of a group outside its usual range, and one for initial overlaps."""
    notes = []
    for group in groups:
        for name, unit, low, high in USUAL:
            values = getattr(crowd, name)[group.rows]
            if ((values < low) | (values > high)).any():
                notes.append(
                    f"people.{group.name}.{name} is {values.min():.3g} to {values.max():.3g} {unit}, which is "
                    f"unusual for people ({low:g} to {high:g} {unit}): is the unit right?"
                )
    pairs, deepest = overlapping(crowd)
    if pairs:
        notes.append(
            f"{counted(pairs, 'pair')} of people overlap at the start, by up to {deepest:.2f} m: depending on the "
            "contact model, they are pushed apart or continue to overlap; correct "
            "people.NAME.positions if this is not intended"
        )
    return tuple(notes)


def overlapping(crowd: Crowd) -> tuple[int, float]:
    """Return the number of overlapping pairs of bodies and the largest overlap [m]."""
    pairs, deepest = 0, 0.0
    for level in np.unique(crowd.level[crowd.level >= 0]):
        rows = np.flatnonzero(crowd.level == level)
        position, greatest = crowd.position[rows], float(greatest_extent(crowd, rows).max())
        for one, other in _pairs_in_cells(position, 2.0 * greatest):
            apart = position[one] - position[other]
            distance = np.hypot(*apart.T)
            nx, ny = (apart / np.where(distance > 0.0, distance, 1.0)[:, None]).T
            overlap = extent(crowd, rows[one], -nx, -ny) + extent(crowd, rows[other], nx, ny) - distance
            pairs += int((overlap > ROUNDING).sum())
            deepest = max(deepest, float(overlap.max(initial=0.0)))
    return pairs, deepest


def _pairs_in_cells(position: FloatArray, size: float) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Yield the pairs of places (n, 2) in the same or adjacent square cells, those in a column and in the next one."""
    column, row = (np.floor((position - position.min(axis=0)) / size).astype(np.int64) + 1).T
    rows = int(row.max()) + 2  # one of them empty, between two columns
    cell = column * rows + row
    order = np.argsort(cell, kind="stable")
    cell, number = cell[order], np.arange(len(cell))
    for first, last in ((number + 1, cell + 1), (np.searchsorted(cell, cell + rows - 1), cell + rows + 1)):
        many = np.searchsorted(cell, last, side="right") - first
        one = np.repeat(number, many)
        yield order[one], order[np.arange(len(one)) + (first - np.cumsum(many) + many)[one]]
