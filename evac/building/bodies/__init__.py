"""Solid bodies of a building model, such as slabs, spaces, walls, doors and flights, to a plan."""

from evac.building.bodies.body import Body
from evac.building.bodies.plan import Rules, plan_of_bodies

__all__ = ["Body", "Rules", "plan_of_bodies"]
