"""The comparison with other programs, with stand-ins for them where what they are given is tested."""

import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from evac.evidence.scaling.halls import make_hall
from evac.evidence.scaling.page import STEP
from evac.evidence.scaling.peers.programs import JupedsimWalk
from evac.evidence.scaling.walks import TICK


class JupedsimStandIn:
    """A simulation in which nobody moves."""

    made: ClassVar[list["JupedsimStandIn"]] = []

    def __init__(self, model, geometry, dt):
        self.model, self.geometry, self.dt = model, geometry, dt
        self.exits, self.agents, self.steps = [], [], 0
        self.made.append(self)

    def add_exit_stage(self, polygon):
        self.exits.append(polygon)
        return len(self.exits) - 1

    def add_journey(self, stages):
        return stages[0]

    def add_agent(self, agent):
        self.agents.append(agent)

    def iterate(self, count):
        self.steps += count

    def agent_count(self):
        return len(self.agents)


@pytest.mark.parametrize("model", ["CollisionFreeSpeedModel", "AnticipationVelocityModel", "SocialForceModel"])
def test_jupedsim_is_given_the_hall_and_its_people(monkeypatch, model):
    parts = {f"{model}AgentParameters": lambda **given: SimpleNamespace(**given), model: lambda: model}
    package = SimpleNamespace(Simulation=JupedsimStandIn, JourneyDescription=list, **parts)
    monkeypatch.setitem(sys.modules, "jupedsim", package)
    monkeypatch.setattr(JupedsimStandIn, "made", [])
    hall = make_hall(500, 2.0, 1)
    walk = JupedsimWalk(hall, STEP, model)
    walk.advance()
    (simulation,) = JupedsimStandIn.made
    assert (walk.inside, simulation.steps, simulation.dt) == (500, round(TICK / STEP), STEP)
    np.testing.assert_array_equal([agent.position for agent in simulation.agents], hall.crowd.position)
    np.testing.assert_array_equal([agent.radius for agent in simulation.agents], hall.crowd.radius)
    np.testing.assert_array_equal([agent.desired_speed for agent in simulation.agents], hall.crowd.speed[:, 0])
    assert len(simulation.exits) == len(hall.building.exits) == 2
    assert simulation.geometry.is_valid
    assert simulation.geometry.geom_type == "Polygon"  # the ground outside is joined through every door
    assert all(simulation.geometry.covers(exit_) for exit_ in simulation.exits)
    for agent in simulation.agents:
        apart = [exit_.distance(simulation.exits[agent.stage_id]) for exit_ in simulation.exits]
        assert min(apart) == apart[agent.stage_id] == 0.0
