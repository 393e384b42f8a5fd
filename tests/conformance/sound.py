"""Short plugins of every kind that work, as source texts."""

BEHAVIOUR = '''"""A behaviour."""
import numpy as np
from evac import Behaviour, Parameter, hookimpl

class Slow(Behaviour):
    """Slow."""
    name = "tried"
    reads = ("position", "speed_factor")
    writes = ("speed_factor",)
    factor = Parameter(0.5, "factor", minimum=0.0, maximum=1.0)
    def act(self, crowd, time):
        crowd.speed_factor[:] *= self.factor

evac_interface = 3

@hookimpl
def evac_behaviours():
    """Register."""
    return [Slow]
'''

PAIR_FORCE = '''"""A force between two people."""
import math
import numpy as np
from evac import Force, Parameter, hookimpl
from evac.jit import body_force, pair_force

@pair_force
def law(gap, nx, ny, vx, vy, ex, ey, parameters):
    return parameters[0] * nx, parameters[0] * ny

class Repels(Force):
    """A force."""
    name = "tried"
    pair = law
    strength = Parameter(100.0, "strength", unit="N", minimum=0.0)
    def cutoff(self):
        """Return the gap."""
        return 0.5

evac_interface = 3

@hookimpl
def evac_forces():
    """Register."""
    return [Repels]
'''

BODY_FORCE = '''"""A force on one person: quadratic drag."""
import math
from evac import Force, Parameter, hookimpl
from evac.jit import body_force

@body_force
def law(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    speed = math.sqrt(vx * vx + vy * vy)
    return -parameters[0] * speed * vx, -parameters[0] * speed * vy

class Drag(Force):
    """Drag of water that stands on the floor."""
    name = "tried"
    body = law
    drag = Parameter(20.0, "drag coefficient", unit="kg/m", minimum=0.0)
    def cutoff(self):
        """Walls do not count."""
        return 0.0

evac_interface = 3

@hookimpl
def evac_forces():
    """Register."""
    return [Drag]
'''

CONTACT = '''"""A contact law."""
import math
from evac import PairContact, Parameter, hookimpl
from evac.jit import pair_contact

@pair_contact
def law(gap, closing_speed, reduced_mass, parameters):
    return -parameters[0] * gap

class Spring(PairContact):
    """A spring."""
    name = "tried"
    pair = law
    stiffness = Parameter(1e5, "stiffness", unit="N/m", above=0.0)

evac_interface = 3

@hookimpl
def evac_contact_models():
    """Register."""
    return [Spring]
'''

COMPILED_LAW = '''"""A contact law without an effect."""
from evac import ContactModel, hookimpl
from evac.jit import kernel
from evac.physics.contact.model import NoParameters
from evac.physics.contact.contacts import use_free_velocity
from evac.physics.state import State

@kernel
def law(state: State, own: NoParameters, h: float) -> int:
    use_free_velocity(state)
    return 0

class Ghosts(ContactModel):
    """People do not feel each other."""
    name = "tried"
    law = law

evac_interface = 3

@hookimpl
def evac_contact_models():
    """Register."""
    return [Ghosts]
'''

SOLVER = '''"""A solver."""
from evac import Solver, hookimpl
from evac.jit import kernel
from evac.physics.contact.rows import renew_velocity, row_residual, sweep_up
from evac.physics.state import Problem

@kernel
def sweeps(problem: Problem, tolerance: float, limit: int) -> int:
    made = 0
    problem.residual = row_residual(problem)
    while problem.residual > tolerance and made < limit:
        sweep_up(problem)
        problem.residual = row_residual(problem)
        made += 1
    return made

class Sweeps(Solver):
    """Sweeps."""
    name = "tried"
    solve = sweeps

evac_interface = 3

@hookimpl
def evac_solvers():
    """Register."""
    return [Sweeps]
'''

RECORDER = '''"""A recorder."""
from evac import Recorder, hookimpl

class Records(Recorder):
    """Records."""
    name = "tried"
    def record(self, simulation):
        simulation.population.crowd.position.mean()
    def finish(self, simulation, results):
        pass

evac_interface = 3

@hookimpl
def evac_recorders():
    """Register."""
    return [Records]
'''

IMPORTER = '''"""An importer."""
from shapely import box
from evac import Importer, Plan, hookimpl

class Reads(Importer):
    """Reads."""
    name = "tried"
    suffixes = (".zz",)
    def read(self, path):
        plan = Plan(path)
        plan.storey("f", [box(0, 0, 5, 5)])
        plan.exit("e", "f", [(0, 1), (0, 2)])
        return plan

evac_interface = 3

@hookimpl
def evac_importers():
    """Register."""
    return [Reads]
'''

EXPORTER = '''"""An exporter."""
import numpy as np
from evac import Exporter, hookimpl

class Writes(Exporter):
    """Writes."""
    name = "tried"
    suffix = ".npz"
    def write(self, trajectory, path):
        np.savez(path, time=trajectory.time)
        return [path]

evac_interface = 3

@hookimpl
def evac_exporters():
    """Register."""
    return [Writes]
'''
