"""A linear spring and a damper between bodies that overlap, compiled."""

from evac import ContactModel, Parameter
from evac.jit import Struct, kernel
from evac.physics.contact.contacts import push
from evac.physics.state import State
from evac.physics.status import OK


class Constants(Struct):
    """What the law reads."""

    stiffness: float  # [kg/s2]
    damping: float  # [kg/s]


@kernel
def spring_damper(state: State, own: Constants, h: float) -> int:
    """Set the percussions of all contacts and the velocities after a sub-step of h [s]."""
    bodies, contacts = state.bodies, state.contacts
    for i in range(bodies.inside):
        for k in range(2):
            bodies.solved[i, k] = bodies.free[i, k]
    for c in range(contacts.number):
        contacts.percussion[c] = 0.0
        if contacts.gap[c] < 0.0:
            force = -own.stiffness * contacts.gap[c] - own.damping * contacts.velocity_before[c]
            contacts.percussion[c] = h * max(force, 0.0)
            push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
    return OK


class SpringDamper(ContactModel):
    """Force max(0, -k D - c w) along the line of centres, with the gap D and its rate w."""

    name = "spring_damper"
    law = spring_damper
    longest_path = 0.5  # steps in which somebody moves farther than half the smallest radius are cut
    remembers = False  # the law does not start from the percussions of the step before
    stiffness = Parameter(1.2e5, "contact stiffness k", unit="kg/s2", above=0.0)
    damping = Parameter(500.0, "damping c", unit="kg/s", minimum=0.0)


evac_interface = 3
