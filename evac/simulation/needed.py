"""Which optional parts a scene needs, and why. Leaving out the others does not change results in any bit."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from evac.base.errors import ScenarioError, counted, plugin_code
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building
from evac.directions.build import build_fields
from evac.directions.descent import add_lengths, descend
from evac.directions.fields import Fields
from evac.directions.routes import STRATEGIES, Route
from evac.directions.sampling import sample_travel_times
from evac.jit import Entry
from evac.jit.kernels import entries_of
from evac.people.behaviour import Behaviour, has_legal_factors, is_legal
from evac.people.groups import default_clearance, narrowest_body, reference_speeds, route_of, routes_of
from evac.people.outside import walk_straight
from evac.people.placement import add_discs
from evac.people.places import routes_to_places
from evac.people.ways import walk_all
from evac.physics.force import Force
from evac.physics.world import walls_behind_exits
from evac.results.ending import add_speeds, count_near
from evac.results.results import PlanRow

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.physics.contact.model import ContactModel
    from evac.physics.engine import Engine
    from evac.simulation.simulation import Simulation

#: The kernels that the directions and people of a scene need.
SET_UP = (descend, sample_travel_times, add_discs, walk_all, is_legal)


def needed_routes(case: "Case", behaviours: Sequence[Behaviour], full: bool) -> tuple[Route, ...]:
    """Return the routes that people can take, each once; `full` adds one of every strategy.

    There is each route of a behaviour without the slopes that groups do not use, too.
    """
    wanted, slopes = list(routes_of(case)), [people.steepest for people in case.people if people.steepest is not None]
    wanted += [route for people in case.people for route in routes_to_places(case, people).values()]
    for behaviour in behaviours:
        with plugin_code(f"behaviour {behaviour.name!r}: routes", behaviour):
            routes = behaviour.routes()
        wanted += [replace(route, steepest=own) for route in routes for own in (route.steepest, *slopes)]
    wanted.extend(_routes_of_events(case))
    if full:
        wanted.extend(Route((), strategy) for strategy in STRATEGIES)
    return tuple(dict.fromkeys(wanted))


def _check_names(case: "Case", building: Building, routes: Sequence[Route]) -> None:
    """Refuse a parameter of a behaviour that names an exit or an area of a route which does not exist."""
    given = [(name, key, value) for name, table in case.behaviours.items() for key, value in (table or {}).items()]
    for what, known, named in (
        ("exit", [way.name for way in building.exits], [name for route in routes for name in route.exits]),
        ("area", [area.name for area in building.areas], [route.area for route in routes if route.area]),
    ):
        for word in (word for word in named if word not in known):
            for name, key, value in given:
                if isinstance(value, Mapping | list | tuple) and word in value:
                    hint = did_you_mean(word, known)
                    raise ScenarioError(f"behaviours.{name}.{key}: there is no {what} {word!r}; {hint}")


def _routes_of_events(case: "Case") -> list[Route]:
    """Return the routes that groups can get by the events of a case, in whatever order these happen."""
    routes: list[Route] = []
    areas = {place.name for place in case.place if place.kind == "assembly"}
    for people in case.people:
        events = [event for event in case.event if event.kind == "strategy" and event.target == people.name]
        values = [event.value for event in events]
        strategies = [people.strategy, *(value for value in values if isinstance(value, str))]
        exits = [people.exits, *(value for value in values if isinstance(value, tuple) and areas.isdisjoint(value))]
        own = route_of(people)
        routes += [replace(own, exits=some, strategy=strategy) for some in exits for strategy in strategies]
    return routes


def field_settings(case: "Case", behaviours: Sequence[Behaviour], full: bool) -> dict[str, Any]:
    """Return the arguments of `build_fields` other than the building."""
    settings = case.directions
    return {
        "routes": needed_routes(case, behaviours, full),
        "spacing": settings.spacing,
        "clearance": default_clearance(case, behaviours) if settings.clearance is None else settings.clearance,
        "narrowest": narrowest_body(case, behaviours),
        "widest": 2.0 * default_clearance(case, behaviours),
        "speeds": reference_speeds(case),
        "comfort": settings.comfort,
        "order": settings.order,
        "keep_grids": bool(case.conditions and case.smoke.routes) or any(one.keeps_distance for one in behaviours),
    }


def solve_fields(
    case: "Case",
    building: Building,
    behaviours: Sequence[Behaviour],
    full: bool,
    workers: int | None,
    anywhere: bool = False,
    routes: Sequence[Route] = (),
) -> Fields:
    """Return the directions for the routes that people can take, and for others; `anywhere` as for `build_fields`."""
    settings = field_settings(case, behaviours, full)
    settings["routes"] = tuple(dict.fromkeys((*settings["routes"], *routes)))
    _check_names(case, building, settings["routes"])
    return build_fields(building.for_ways, **settings, workers=workers, anywhere=anywhere)


def needed_forces(forces: Sequence[Force], full: bool) -> list[Force]:
    """Return the forces that are not zero everywhere; with `full`, all of them."""
    needed = []
    for force in forces:
        with plugin_code(f"force {force.name!r}: is_needed", force):
            needed += [force] if full or force.is_needed() else []
    return needed


def run_kernels(
    case: "Case",
    engine: "type[Engine]",
    building: Building,
    model: "ContactModel",
    forces: Sequence[Force],
    behaviours: Sequence[Behaviour],
    full: bool,
) -> list[Entry]:
    """Return the kernels of engine, behaviours and routes that are known to be needed at the start of a run."""
    kernels = [*engine.kernels(model, forces, case.registry.solvers, walls_behind_exits(building), full)]
    kernels += [add_speeds, count_near]
    for behaviour in behaviours:
        kernels += entries_of(sys.modules[type(behaviour).__module__])
    routes, keeps = needed_routes(case, behaviours, full), any(one.keeps_distance for one in behaviours)
    kernels += [walk_straight, has_legal_factors] if keeps else []
    follow = keeps or any(route.follows_crowd for route in routes)
    if follow or (case.conditions and case.smoke.routes):
        from evac.directions.march.waves import deposit, march_waves

        kernels += [deposit, march_waves] if follow else [march_waves]
    if len(routes) > len(routes_of(case)):  # they are compared by their lengths
        kernels += [add_lengths]
    return kernels


def explain(simulation: "Simulation", forces: Sequence[Force], behaviours: Sequence[Behaviour]) -> list[PlanRow]:
    """Return every optional part of a simulation, whether it is used, and why, with what its case names."""
    case, building, model = simulation.case, simulation.building, simulation.contact
    effects, acts = simulation.engine.explain_forces(), simulation.deciding.acts
    keepers = [behaviour.name for behaviour, _ in simulation.behaviours if behaviour.keeps_distance]
    portals, flights = len(building.portals), sum(level.kind == "flight" for level in building.levels)
    parts = [
        _part("portals", portals > 0, f"{counted(portals, 'portal')}, {counted(len(building.levels), 'level')}"),
        _part("stair speeds", flights > 0, f"{flights} sloped levels"),
    ]
    for strategy in STRATEGIES:
        ways = ", ".join(f"to {route.destination}" for route in simulation.fields.routes if route.strategy == strategy)
        why = f"people can go {ways}" if ways else "nobody can take such a route"
        parts.append(_part(f"fields: {strategy}", bool(ways), why))
    for force in forces:
        effect = effects.get(force.name)
        parts.append(_part(f"force: {force.name}", effect is not None, effect or "it is zero everywhere"))
    if not forces:
        parts.append(_part("forces at a distance", False, "none named in [forces]"))
    when = {None: "it affects nobody", True: "at every tick", False: "once, before the first step"}
    for behaviour in behaviours:
        at_ticks = acts.get(behaviour.name)
        parts.append(_part(f"behaviour: {behaviour.name}", at_ticks is not None, when[at_ticks]))
    if not behaviours:
        parts.append(_part("behaviours", False, "none named in [behaviours]"))
    ways = f"{', '.join(keepers)}: from 1 person per m2 on" if simulation.scene.local else "nobody keeps distances"
    parts.append(_part("ways round the crowd", simulation.scene.local is not None, ways))
    seen_by = f"seen by {', '.join(keepers)}" if keepers else "no behaviour keeps distances"
    parts.append(_part("people outside", bool(keepers), seen_by))
    with plugin_code(f"contact model {model.name!r}: parts", model):
        parts.extend(_part(*row) for row in model.parts())
    parts.extend(_part(*row) for row in simulation.engine.explain(model))
    parts.append(_part("contact solves", True, "only in steps with contacts in reach"))
    for name in ("tables", "picture", "replay", "trajectory", "animation"):
        is_wanted = getattr(case.output, name)
        parts.append(_part(name, is_wanted, f"output.{name} = {str(is_wanted).lower()}"))
        if name == "replay" and is_wanted and not case.output.trajectory:
            parts[-1] = _part(name, False, "output.trajectory = false")
    return parts


def _part(name: str, is_in: bool, why: str) -> PlanRow:
    return PlanRow(name, "in" if is_in else "out", why)
