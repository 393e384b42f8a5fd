"""Convert the solid bodies of a building model (slabs, spaces, walls, doors, flights) to a plan."""

from evac.building.recover.bodies.body import Body
from evac.building.recover.bodies.conversion import Rules, plan_of_bodies

__all__ = ["Body", "Rules", "plan_of_bodies"]
