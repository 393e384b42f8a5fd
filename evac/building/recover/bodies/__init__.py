"""Convert the solid bodies of a building model (slabs, spaces, walls, doors, flights) to a plan."""

from evac.building.recover.bodies.body import Body
from evac.building.recover.bodies.conversion import plan_of_bodies
from evac.building.recover.bodies.floors import Rules

__all__ = ["Body", "Rules", "plan_of_bodies"]
