import textwrap

import pytest

from evac.registry import Registry

PLUGIN = """
    from evac.hookspecs import hookimpl
    from evac import Behaviour, ContactModel, Force, Parameter

    class Soft(ContactModel):
        name = "soft"
        stiffness = Parameter(1000.0, "stiffness", unit="N/m", above=0)

    class Hard(ContactModel):
        name = "hard"
        solver = Parameter("cg", "solver", choices=("cg", "gauss_seidel"))

    class Push(Force):
        name = "push"
        strength = Parameter(2000.0, "strength", unit="N", minimum=0)

        def cutoff(self):
            return 1.0

    class Wait(Behaviour):
        name = "wait"
        group_keys = ("time", "leader")
        time = Parameter({"uniform": [0.0, 10.0]}, "time", unit="s", minimum=0, distribution=True)
        shared = Parameter(False, "shared")

    class Follow(Behaviour):
        name = "follow"
        group_keys = ("leader",)

    @hookimpl
    def evac_contact_models():
        return [Soft, Hard]

    @hookimpl
    def evac_forces():
        return [Push]

    @hookimpl
    def evac_behaviours():
        return [Wait, Follow]
"""

CASE = """
    title = "Two groups in a room"

    [building]
    mesh = "room.msh"

    [[people]]
    name = "pupils"
    number = 5
    area = "desks"
    radius = 0.2
    speed_up = { factor = 0.5 }
    behaviours = { wait = { time = { uniform = [0, 2] } } }

    [[people]]
    name = "teacher"
    positions = [[1.0, 2.0]]
    level = "ground"
    strategy = "shortest"

    [contact]
    model = "soft"
    [contact.soft]
    stiffness = 500
    [contact.hard]
    solver = "gauss_seidel"

    [forces.push]
    strength = 100

    [behaviours.wait]
    shared = true
    [behaviours]
    follow = false

    [simulation]
    seed = 3
"""


@pytest.fixture(scope="session")
def registry(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "fakes.py"
    path.write_text(textwrap.dedent(PLUGIN), encoding="utf-8")
    return Registry([path], builtins=())


@pytest.fixture
def case_file(tmp_path):
    """A valid case.toml of two groups, beside a mesh file that is only looked for."""
    (tmp_path / "room.msh").write_text("", encoding="utf-8")
    path = tmp_path / "case.toml"
    path.write_text(textwrap.dedent(CASE), encoding="utf-8")
    return path
