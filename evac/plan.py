"""What a scene needs: each part that can be left out, in or out, and why. Leaving out changes no bit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from evac.behaviour import Behaviour, BehaviourScene
from evac.directions.routes import STRATEGIES, Route
from evac.errors import plugin_code
from evac.people.groups import routes_of
from evac.physics.force import Force

if TYPE_CHECKING:
    from evac.building.model import Building
    from evac.physics.contact_model import ContactModel
    from evac.scenario.schema import Case


@dataclass(frozen=True)
class Part:
    """One part of the framework and whether the scene needs it."""

    name: str
    is_in: bool
    why: str

    def as_row(self) -> tuple[str, str, str]:
        """Return name, in or out, why."""
        return self.name, "in" if self.is_in else "out", self.why


def needed_routes(case: "Case", behaviours: Sequence[Behaviour], full: bool) -> tuple[Route, ...]:
    """Return the routes that somebody can take, each once; `full` adds one of every strategy."""
    wanted = list(routes_of(case))
    for behaviour in behaviours:
        with plugin_code(f"behaviour {behaviour.name!r}: routes"):
            wanted.extend(behaviour.routes())
    if full:
        wanted.extend(Route((), strategy) for strategy in STRATEGIES)
    return tuple(dict.fromkeys(wanted))


def needed_forces(forces: Sequence[Force], full: bool) -> list[Force]:
    """Return the forces that push anybody."""
    needed = []
    for force in forces:
        with plugin_code(f"force {force.name!r}: is_needed"):
            if full or force.is_needed():
                needed.append(force)
    return needed


def explain(
    case: "Case",
    building: "Building",
    model: "ContactModel",
    forces: Sequence[Force],
    behaviours: Sequence[tuple[Behaviour, BehaviourScene]],
    routes: Sequence[Route],
) -> list[Part]:
    """Return every part that can be left out, in or out, and why."""
    levels = len(building.levels)
    parts = [
        Part("portals", bool(building.portals), f"{len(building.portals)} portals between {levels} levels"),
        Part(
            "stair speeds",
            any(level.kind == "flight" for level in building.levels),
            f"{sum(level.kind == 'flight' for level in building.levels)} sloped levels",
        ),
    ]
    for strategy in STRATEGIES:
        users = [route for route in routes if route.strategy == strategy]
        routes_of = ", ".join("to " + ("|".join(route.exits) or "any exit") for route in users)
        why = f"somebody can go {routes_of}" if users else "nobody can take such a route"
        parts.append(Part(f"fields: {strategy}", bool(users), why))
    for force in forces:
        why = f"felt up to a gap of {force.cutoff():.2f} m" if force.is_needed() else "it is zero everywhere"
        parts.append(Part(f"force: {force.name}", force.is_needed(), why))
    if not forces:
        parts.append(Part("forces at a distance", False, "none named in [forces]"))
    for behaviour, scene in behaviours:
        needed = behaviour.is_needed(scene)
        why = "nobody is concerned"
        if needed:
            why = "at every tick" if behaviour.acts_at_ticks() else "once, before the first step"
        parts.append(Part(f"behaviour: {behaviour.name}", needed, why))
    if not behaviours:
        parts.append(Part("behaviours", False, "none named in [behaviours]"))
    parts.extend(Part(*row) for row in model.parts())
    parts.append(Part("contact solves", True, "only in steps that have contacts in reach"))
    output = case.output
    parts.append(Part("animation", output.animation, f"output.animation = {str(output.animation).lower()}"))
    parts.append(Part("picture", output.picture, f"output.picture = {str(output.picture).lower()}"))
    return parts
