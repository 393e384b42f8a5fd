"""DEM, the smooth contact model: linear springs between overlapping bodies (eqs 3, 16, 17)."""

from collections.abc import Mapping

from evac.base.parameters import Parameter
from evac.jit import pair_contact
from evac.physics.contact.pair_contact import PairContact
from evac.physics.status import CENTRES_PASSED, TOO_STIFF, WALL_CROSSED


@pair_contact
def spring(gap, closing_speed, reduced_mass, parameters):
    """Return the force k D of an overlap D [N]."""
    return -parameters[0] * gap


class Dem(PairContact):
    """Spring contact: a force k max(0, -D) along the line of centres; overlap is part of the model."""

    name = "dem"
    pair = spring
    stiffness = Parameter(1.2e5, "contact stiffness k of eq. 3", unit="kg/s2", above=0.0)

    def advice(self) -> Mapping[int, str]:
        """Return what to change if a step fails."""
        stiffer = "a greater contact.dem.stiffness with a shorter simulation.step, or contact.model = 'nsm1'"
        return {
            WALL_CROSSED: f"use {stiffer}",
            CENTRES_PASSED: f"use [behaviours.walking], {stiffer}",
            TOO_STIFF: "reduce contact.dem.stiffness, or use a smaller simulation.step",
        }
