import textwrap

import pytest

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


@pytest.fixture
def case_file(tmp_path):
    """A valid case.toml of two groups, beside a mesh file that is only looked for."""
    (tmp_path / "room.msh").write_text("", encoding="utf-8")
    path = tmp_path / "case.toml"
    path.write_text(textwrap.dedent(CASE), encoding="utf-8")
    return path
