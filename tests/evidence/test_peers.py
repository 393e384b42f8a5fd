"""The comparison with JuPedSim, with a stand-in for that package: it shows what the package is given."""

import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from evac.evidence.scaling import peers
from evac.evidence.scaling.halls import make_hall
from evac.evidence.scaling.page import STEP


class StandIn:
    """A simulation in which nobody moves, and of which one model fails in the second tick."""

    made: ClassVar[list["StandIn"]] = []

    def __init__(self, model, geometry, dt):
        self.model, self.geometry, self.dt = model, geometry, dt
        self.exits, self.agents, self.ticks = [], [], 0
        self.made.append(self)

    def add_exit_stage(self, polygon):
        self.exits.append(polygon)
        return len(self.exits) - 1

    def add_journey(self, stages):
        return stages[0]

    def add_agent(self, agent):
        self.agents.append(agent)

    def iterate(self, count):
        assert count == round(peers.TICK / self.dt)
        self.ticks += 1
        if self.model == "SocialForceModel" and self.ticks == 2:
            raise RuntimeError("Point (1, 2) is outside of accessible area")

    def agent_count(self):
        return len(self.agents)


@pytest.fixture
def stand_in(monkeypatch):
    names = peers.THEIRS.values()
    parts = {f"{name}AgentParameters": lambda **given: SimpleNamespace(**given) for name in names}
    parts |= {name: (lambda name=name: name) for name in names}
    package = SimpleNamespace(Simulation=StandIn, JourneyDescription=list, **parts)
    monkeypatch.setitem(sys.modules, "jupedsim", package)
    monkeypatch.setattr(StandIn, "made", [])


def test_all_programs_start_alike_and_one_that_fails_keeps_its_message(stand_in):
    hall = make_hall(60, 2.0, 1)
    costs = peers.compare(hall, STEP)
    assert "outside" in costs.pop("JuPedSim, social force")
    assert {name: len(spans) for name, spans in costs.items()} == dict.fromkeys(costs, peers.TIMED)
    assert len(costs) == 4
    for simulation in StandIn.made:
        np.testing.assert_array_equal([agent.position for agent in simulation.agents], hall.crowd.position)
        np.testing.assert_array_equal([agent.radius for agent in simulation.agents], hall.crowd.radius)
        np.testing.assert_array_equal([agent.desired_speed for agent in simulation.agents], hall.crowd.speed[:, 0])
        assert len(simulation.exits) == len(hall.building.exits)
        assert simulation.geometry.is_valid
        assert simulation.geometry.geom_type == "Polygon"  # the ground outside is joined through every door
        assert all(simulation.geometry.covers(exit_) for exit_ in simulation.exits)
