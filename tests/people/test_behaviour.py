"""What a behaviour can do besides writing to the arrays of people: change the scene, read its files, own fields."""

import textwrap

import numpy as np
import pytest

import evac
from evac.base.errors import PluginError, ResultError, ScenarioError
from evac.base.saved import FINITE
from evac.conformance import check_plugin
from evac.people.behaviour import Behaviour, check_written, is_legal
from evac.results.ending import Stopped
from evac.simulation.simulation import Simulation
from tests.runs import run_ticks
from tests.three_storeys import crowd_at

SMOKE = """
    import numpy as np
    from evac import Behaviour, Change, Parameter
    evac_interface = 3

    class Smoke(Behaviour):
        '''Smoke rises as a file says, people walk slowly in it, and a door closes.'''
        name = "smoke"
        reads = ("level", "position")
        writes = ("speed_factor",)
        file = Parameter("rate.txt", doc="file with the rate of the density")

        def prepare(self, scene):
            self.scene = scene
            self.rate = float(scene.file(self.file).read_text())
            self.field = scene.level_field("smoke", "1/m", 0.5)
            scene.apply(Change(1.5, "close", "back"))

        def act(self, crowd, time):
            self.field.on(0)[:, :4] += self.rate
            crowd.speed_factor[:] = np.exp(-self.field.at(crowd.level, crowd.position))
            {more}

        def state(self):
            return {{}}
"""

CASE = """
    [building]
    mesh = "room.obj"
    exits = [
        { name = "front", segment = [[5.0, 1.0], [5.0, 2.5]], z = 0.0 },
        { name = "back", segment = [[0.0, 1.0], [0.0, 2.5]], z = 0.0 },
    ]
    [contact]
    model = "nsm2"
    [simulation]
    duration = 4.0
    [output]
    every = 0.5
    picture = false
    [[people]]
    name = "people"
    number = 12
    level = "floor z=0.00"
    [behaviours.smoke]
"""


@pytest.fixture
def smoky(tmp_path):
    """Return a function that makes a case of a room with two exits, and smoke in its left part."""

    def make(more="pass"):
        (tmp_path / "smoke.py").write_text(textwrap.dedent(SMOKE.format(more=more)))
        (tmp_path / "rate.txt").write_text("0.02")
        (tmp_path / "room.obj").write_text("v 0 0 0\nv 5 0 0\nv 5 4 0\nv 0 4 0\nf 1 2 3 4\n")
        (tmp_path / "case.toml").write_text(CASE)
        return evac.load(tmp_path / "case.toml", plugin_files=[tmp_path / "smoke.py"])

    return make


def test_a_field_slows_people_and_is_seen_by_others_but_written_by_none(smoky):
    simulation = run_ticks(Simulation(smoky()), 10)
    field = simulation.scene.fields_of_behaviours["smoke"]
    assert (field.unit, field.cells[0].shape, field.size) == ("1/m", (8, 10), 80)
    assert np.allclose(field.on(0)[:, :4], 0.2)
    assert not field.on(0)[:, 4:].any()
    places = np.array([[1.9, 1.0], [2.1, 1.0], [1.9, 1.0]])
    assert field.at([0, 0, -1], places).tolist() == pytest.approx([0.2, 0.0, 0.0])
    with pytest.raises(ValueError, match="read-only"):
        field.values[:] = 0.0
    assert simulation.population.crowd.speed_factor.min() == pytest.approx(np.exp(-0.2))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("self.field.values[3] = np.nan", r"wrote nan to its field 'smoke'.*smoke\.py"),
        ("self.field.values = np.zeros(3)", r"replaces the values of its field 'smoke'.*in place"),
        ("self.scene.level_field('more', '')", r"'more': the run has begun.*prepare\(\)"),
        ("self.scene.scene.fields_of_behaviours['smoke'].values[:] = 1.0", "read-only"),
    ],
)
def test_what_a_behaviour_may_not_do_with_a_field_is_told(smoky, more, words):
    with pytest.raises(PluginError, match=words):
        Simulation(smoky(more)).advance_tick()


def test_a_behaviour_that_changes_the_scene_and_owns_a_field_passes_the_checks(smoky):
    case = smoky()
    check_plugin(case.registry.behaviours["smoke"], case.change({"people.people.number": 4}))


@pytest.mark.parametrize(
    ("name", "legal", "illegal"),
    [
        ("route", (0, 1), (-1, 2)),
        ("start_time", (-1.0, np.inf), (np.nan,)),
        ("speed_factor", (0.0, FINITE), (-1e-300, np.inf, np.nan)),
        ("speed", (0.0, FINITE), (-1e-300, np.inf, np.nan)),
        ("extra_direction", (-FINITE, FINITE), (-np.inf, np.inf, np.nan)),
    ],
)
def test_numbers_that_may_be_written_of_people_have_bounds(name, legal, illegal):
    for values, expected in ((legal, True), (illegal, False)):
        for value in values:
            for last in (False, True):
                crowd = crowd_at(np.zeros((3, 2)), np.zeros(3, np.int32))
                assert is_legal(crowd, 2)
                getattr(crowd, name).reshape(-1)[-1 if last else 0] = value
                assert is_legal(crowd, 2) == expected


class Odd(Behaviour):
    """Writes what it may."""

    name = "odd"
    writes = ("route", "start_time", "speed_factor", "extra_direction")

    def act(self, crowd, time):
        """Do nothing."""


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("route", 2, "wrote route 2 for person 1"),
        ("route", -1, "wrote route -1 for person 1"),
        ("start_time", np.nan, "wrote nan to start_time of person 1"),
        ("speed_factor", -0.5, "wrote -0.5 to speed_factor of person 1"),
        ("speed_factor", np.inf, "wrote inf to speed_factor of person 1"),
        ("extra_direction", [0.0, np.nan], r"wrote \[ *0\. +nan\] to extra_direction of person 1"),
    ],
)
def test_the_first_person_for_whom_a_behaviour_writes_what_is_illegal_is_named(name, value, words):
    crowd = crowd_at(np.zeros((3, 2)), np.zeros(3, np.int32))
    check_written(Odd(), [], crowd, None, 2, 1.5)
    getattr(crowd, name)[1:] = value
    with pytest.raises(PluginError, match=rf"^t = 1\.500 s: behaviour 'odd': {words} \(.*test_behaviour\.py"):
        check_written(Odd(), [], crowd, None, 2, 1.5)


def test_files_are_read_from_the_folder_of_the_case_only(smoky, tmp_path):
    smoky()
    inside = tmp_path / "case"
    inside.mkdir()
    for name in ("case.toml", "room.obj", "smoke.py"):
        (tmp_path / name).rename(inside / name)
    (inside / "link.txt").symlink_to(tmp_path / "rate.txt")
    case = evac.load(inside, plugin_files=[inside / "smoke.py"])
    for name, words in (("../rate.txt", "outside"), ("link.txt", "outside"), ("rate.txt", "no such file")):
        with pytest.raises(ScenarioError, match=rf"case\.toml: .*{name}.*{words}"):
            Simulation(case.change({"behaviours.smoke.file": name}), will_run=False)


def test_a_run_is_not_resumed_with_other_data(smoky, tmp_path):
    def stop(progress):
        if progress.time > 0.9:
            raise Stopped

    evac.run(smoky(), tmp_path / "r", progress=stop)
    files = {"plugin_files": [tmp_path / "smoke.py"]}
    (tmp_path / "rate.txt").write_text("0.03")
    with pytest.raises(ResultError, match=r"data rate\.txt: \w+ when"):
        evac.resume(tmp_path / "r", **files)
    (tmp_path / "rate.txt").write_text("0.02")
    evac.resume(tmp_path / "r", **files)


def test_a_field_reaches_the_trajectory_also_of_a_run_that_is_resumed(smoky, tmp_path):
    def stop(progress):
        if progress.time > 0.9:
            raise Stopped

    case = smoky()
    evac.run(case, tmp_path / "whole")
    evac.run(case, tmp_path / "r", progress=stop)
    evac.resume(tmp_path / "r", plugin_files=[tmp_path / "smoke.py"])
    paths = [tmp_path / name / "trajectory.evac" for name in ("whole", "r")]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    trajectory = evac.read_trajectory(tmp_path / "r")
    field = trajectory.field("smoke")
    assert (field.unit, field.spacing, field.values.shape) == ("1/m", 0.5, (len(trajectory), 80))
    assert field.on(0).shape == (len(trajectory), 8, 10)
    ticks = np.rint(trajectory.time / case.simulation.tick)
    np.testing.assert_allclose(field.at([0, 0], np.array([[1.0, 1.0], [4.0, 1.0]])).T, [0.02 * ticks, 0.0 * ticks])
    with pytest.raises(ResultError, match=r"'smok'.*'smoke'"):
        trajectory.field("smok")
