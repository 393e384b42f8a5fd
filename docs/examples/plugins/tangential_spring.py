"""A spring and a damper along the normal, and a spring along the tangent that slips (Cundall and Strack, 1979)."""

from evac import PairContact, Parameter
from evac.jit import pair_friction


@pair_friction
def stick_or_slip(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    """Return k D + c w with the overlap D = -gap and the closing speed w, and -k_t times the stretch of the tangent."""
    force = max(-parameters[0] * gap + parameters[1] * closing_speed, 0.0)
    longest = parameters[3] * force / parameters[2]  # the stretch at which the friction is mu times the force
    memory[0] = min(max(memory[0] + elapsed * sliding_speed, -longest), longest)
    return force, -parameters[2] * memory[0]


class TangentialSpring(PairContact):
    """Static and sliding friction of people with each other and with walls."""

    name = "tangential_spring"
    pair = stick_or_slip
    memory = ("stretch",)
    stiffness = Parameter(1.2e5, "stiffness k along the normal", unit="kg/s2", above=0.0)
    damping = Parameter(500.0, "damping c along the normal", unit="kg/s", minimum=0.0)
    tangential_stiffness = Parameter(8e4, "stiffness k_t along the tangent", unit="kg/s2", above=0.0)
    friction = Parameter(0.4, "coefficient of friction mu", minimum=0.0)


evac_interface = 3
