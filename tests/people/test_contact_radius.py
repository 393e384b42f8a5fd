"""Bodies that touch may be narrower than the people: shoulders turn, and a behaviour states by how much."""

import textwrap

import numpy as np
import pytest
from shapely import box

import evac
from evac.simulation.simulation import Simulation
from tests.runs import MODELS, run_ticks

THIN = """
    import numpy as np
    from evac import Behaviour, Parameter
    evac_interface = 3

    class Thin(Behaviour):
        '''Bodies with the depth of a chest.'''
        name = "thin"
        group_keys = ("depth",)
        depth = Parameter(0.3, "depth of the chest", "m", above=0.0)

        def contact_radius(self, radius, settings):
            return {returned}
"""

#: Half the depth of the chest, or the radius.
HALF_DEPTH = "np.minimum(radius, settings.get('depth', self.depth) / 2)"


@pytest.fixture
def thin(tmp_path):
    """Return a function that makes a case of a room whose only exit is behind a gap of 0.4 m."""

    def make(returned=HALF_DEPTH, behaviour=True, **more):
        file = tmp_path / "thin.py"
        file.write_text(textwrap.dedent(THIN.format(returned=returned)))
        plan = evac.Plan()
        plan.storey("floor", box(0, 0, 5, 4).union(box(5, 1.8, 5.2, 2.2)).union(box(5.2, 1, 7, 3)))
        plan.exit("out", "floor", [(7, 1), (7, 3)])
        people = {"name": "people", "number": 8, "level": "floor", "radius": 0.22, "exits": ["out"]}
        content = {
            "building": plan,
            "people": [people | more],
            "contact": {"model": "nsm2"},
            "output": {"trajectory": False},
            "behaviours": {"thin": {}} if behaviour else {},
        }
        return evac.load(content, plugin_files=[file])

    return make


def test_bodies_pass_gaps_that_are_wider_than_their_contact_diameter(thin):
    results = evac.run(thin())
    assert results.ended == "everybody out"
    assert (results.crowd.radius == 0.22).all()
    assert (results.crowd.contact_radius == 0.15).all()
    before = thin(behaviour=False, number=None, positions=[[2.0, 2.0]])
    assert evac.run(before).ended != "everybody out"


def test_a_group_has_a_depth_of_its_own(thin):
    crowd = Simulation(thin(behaviours={"thin": {"depth": 0.25}})).population.crowd
    assert (crowd.contact_radius == 0.125).all()


def test_people_are_placed_with_their_radius(thin):
    position = Simulation(thin(number=25)).population.crowd.position
    apart = np.hypot(*(position[:, None] - position).transpose(2, 0, 1)) + np.eye(25)
    assert apart.min() >= 2 * 0.22


@pytest.mark.parametrize("model", MODELS)
def test_bodies_touch_at_their_contact_radius(thin, model):
    case = thin(positions=[[3.0, 2.0], [3.6, 2.0]], number=None, speed={"list": [1.5, 0.0]})
    simulation = Simulation(case.change({"contact.model": model}))
    apart = []
    for _ in range(10):
        run_ticks(simulation, 1)
        apart.append(np.hypot(*(simulation.population.crowd.position[1] - simulation.population.crowd.position[0])))
    assert 0.28 < min(apart) < 0.33  # between two ticks, and far below 0.44
