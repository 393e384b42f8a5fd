"""The spring contact of DEM in plain numpy."""

import numpy as np

from evac import ContactModel, Parameter, ScenarioError


class DemNumpy(ContactModel):
    """Force k min(0, D) along the line of centres (eq. 3)."""

    name = "dem_numpy"
    stiffness = Parameter(1.2e5, "contact stiffness k", unit="kg/s2", above=0.0)

    def check_scene(self, scene):
        """Refuse a step at which a dense packing is unstable, h^2 6k/m >= 4 less what the drive takes of it."""
        ratio = scene.step / scene.tau.min()
        limit = 4.0 - 2.0 * ratio if scene.explicit else 2.0 * (1.0 + np.exp(-ratio))
        if scene.step**2 * 6.0 * self.stiffness / scene.mass.min() >= limit:
            raise ScenarioError(f"simulation.step: {scene.step} s is too long for contact model {self.name!r}")

    def step(self, contacts, h):
        """Return the velocities after a step; the percussions are kept for contact forces and energy."""
        contacts.percussion[:] = -h * self.stiffness * np.minimum(contacts.gap, 0.0)
        push = contacts.percussion[:, None] * contacts.normal
        velocity = contacts.free.copy()
        np.add.at(velocity, contacts.body, push / contacts.mass[contacts.body, None])
        two = contacts.other >= 0  # -1 is a wall
        other = contacts.other[two]
        np.subtract.at(velocity, other, push[two] / contacts.mass[other, None])
        return velocity


evac_interface = 3
