"""The plugins of docs/examples/plugins run, and docs/plugins*.md quote them as they are."""

import math
import re
import runpy
import sys

import numpy as np
import pytest

import evac
from evac.conformance import check_plugin
from evac.contract.registry import Registry
from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from tests.physics.scenes import kinetic_energy, make_building, make_engine, uniform_fields, walk

NAMES = [
    *(
        "crowding.py",
        "fetch_child.py",
        "personal_space.py",
        "centrifugal.py",
        "keep_right.py",
        "dem_numpy.py",
        "hertz.py",
        "tangential_spring.py",
    ),
    *("spring_damper.py", "jacobi.py", "plain.py"),
    *("rooms.py", "positions.py", "crossing_guard.py"),
]


def positions(case, ticks):
    simulation = evac.Simulation(case)
    for _ in range(ticks):
        simulation.advance_tick()
    return simulation.population.crowd.position


def home(plugin_files):
    plan = evac.Plan()
    plan.storey("home", [(0, 0), (14, 0), (14, 6), (0, 6)])
    plan.exit("door", "home", [(0, 2), (0, 4)])
    plan.area("hall", "home", [(1, 1), (4, 1), (4, 5), (1, 5)])
    plan.area("playroom", "home", [(10, 1), (13, 1), (13, 5), (10, 5)])
    groups = (("parents", "hall"), ("children", "playroom"))
    people = [{"name": name, "area": area, "number": 4} for name, area in groups]
    table = {"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"fetch_child": {}}}
    return evac.load(table, plugin_files=[plugin_files["fetch_child.py"]])


def test_parents_fetch_their_children_and_leave_with_them(plugin_files):
    """Nobody leaves without the other, and parents walk to the playroom and back: 6 m at least, twice."""
    assert len(plugin_files["fetch_child.py"].read_text().splitlines()) <= 40
    results = evac.run(home(plugin_files))
    children, parents = (group.rows for group in results.groups)
    assert results.evacuated == 8
    assert (results.crowd.distance[parents] > 12.0).all()
    assert (results.crowd.start_time[children] > 2.0).all()
    together = results.crowd.exit_time[children] - results.crowd.exit_time[parents]
    assert np.abs(together).max() < 4.0


def test_every_file_is_tried_here_and_quoted_as_it_is(plugin_files, root):
    assert sorted([*NAMES, "test_my_plugins.py"]) == sorted(plugin_files)
    pages = "".join(page.read_text(encoding="utf-8") for page in (root / "docs").glob("plugins*.md"))
    quoted = re.findall(
        r"^\[(\w+\.py)\]\(examples/plugins/\1\):\n\n```python\n(.*?)^```", pages, re.MULTILINE | re.DOTALL
    )
    assert len(quoted) == pages.count("```python") > 10
    for name, block in quoted:
        lines = map(str.strip, plugin_files[name].read_text(encoding="utf-8").splitlines())
        shown = (line.strip().removesuffix(" ...") for line in block.splitlines())
        assert all(line in lines for line in shown if line not in ("", "...")), name


@pytest.mark.parametrize("name", NAMES)
def test_a_documented_plugin_is_one_class_that_conforms(plugin_files, name):
    registry = Registry([plugin_files[name]])
    classes = [
        cls
        for table in (
            registry.contact_models,
            registry.solvers,
            registry.forces,
            registry.behaviours,
            registry.recorders,
            registry.importers,
            registry.exporters,
        )
        for cls in table.values()
        if sys.modules[cls.__module__].__file__ == str(plugin_files[name])
    ]
    assert len(classes) == 1
    if f"import {plugin_files[name].stem}\n" not in plugin_files["test_my_plugins.py"].read_text():
        check_plugin(
            classes[0], home(plugin_files) if name == "fetch_child.py" else None
        )  # the others conform in the documented tests, which are run below


def test_documented_tests_pass(plugin_files, monkeypatch):
    monkeypatch.syspath_prepend(plugin_files["test_my_plugins.py"].parent)
    names = runpy.run_path(str(plugin_files["test_my_plugins.py"]))
    (test,) = [function for name, function in names.items() if name.startswith("test_")]
    test()


def test_a_numpy_contact_model_equals_the_compiled_one(plugin_files):
    case = evac.load("square_room", {"contact.model": "dem"}, plugin_files=[plugin_files["dem_numpy.py"]])
    compiled = positions(case, 20)
    plain = positions(case.change({"contact.model": "dem_numpy"}), 20)
    assert case.simulation.step == 0.01
    assert case.simulation.tick == 0.1
    np.testing.assert_allclose(plain, compiled, rtol=0.0, atol=1e-12)
    unlike = positions(case.change({"contact.model": "nsm2"}), 20)
    assert np.abs(unlike - compiled).max() > 1e-3


def test_a_compiled_law_in_a_file_is_the_spring_of_dem(plugin_files):
    plain = positions(evac.load("square_room", {"contact.model": "dem"}), 20)
    case = evac.load("square_room", {"contact.model": "spring_damper"}, plugin_files=[plugin_files["spring_damper.py"]])
    undamped = positions(case.change({"contact.spring_damper": {"damping": 0.0}}), 20)
    np.testing.assert_allclose(undamped, plain, rtol=0.0, atol=1e-12)
    assert np.abs(positions(case, 20) - plain).max() > 1e-4


def class_of(plugin_files, name, hook):
    return getattr(Registry([plugin_files[f"{name}.py"]]), hook)[name]


@pytest.mark.parametrize("mass", [50.0, 90.0])
def test_two_people_collide_as_hertz_says(plugin_files, mass):
    """Deepest is (5 m v^2 / 4K)^(2/5), and 2.94327 of it over v later they part, with the energy that they had."""
    model = class_of(plugin_files, "hertz", "contact_models")()
    crowd = make_crowd([(-0.21, 0), (0.21, 0)], [(1.5, 0), (-1.5, 0)], radius=0.2, mass=mass, tau=1e30)
    report = walk(model, crowd, 5000, h=2e-5, tick=100).report()
    deepest = (1.25 * 0.5 * mass * 3.0**2 / 1e6) ** 0.4
    assert report["greatest_overlap"] == pytest.approx(deepest, rel=1e-3)
    assert report["contacts"] * 2e-5 == pytest.approx(2.94327 * deepest / 3.0, rel=2e-3)
    assert kinetic_energy(crowd) == pytest.approx(mass * 1.5**2, rel=2e-3)


WALL = make_building(walls=[(0, -60, 0, 60)])

#: Desired force on a person who leans on the wall [N], and its mass [kg] and relaxation time [s].
LEAN, MASS, TAU = 800.0, 80.0, 0.1


def leaning(model, ratio, steps, h=1e-3):
    """Let a disc be driven into a wall, and along it by `ratio` of the force into it."""
    turn = math.atan(ratio)
    crowd = make_crowd([(-0.2, 0.0)], radius=0.2, mass=MASS, tau=TAU, speed=LEAN * TAU / MASS)
    fields = uniform_fields(1, (math.cos(turn), math.sin(turn)))
    engine = make_engine(crowd, WALL, fields)
    walk(model, crowd, steps, h=h, engine=engine, tick=10)
    return crowd, turn


@pytest.mark.parametrize("mu", [0.2, 0.7])
def test_a_disc_at_a_wall_sticks_below_the_limit_of_coulomb_and_slides_above(plugin_files, mu):
    """It rests, with the spring stretched by the force along the wall, or slides at tau (F_t - mu F_n) / m."""
    model = class_of(plugin_files, "tangential_spring", "contact_models")(friction=mu, damping=5000.0)
    crowd, turn = leaning(model, 0.999 * mu, 8000)
    assert np.abs(crowd.velocity).max() < 1e-9
    assert crowd.position[0, 0] == pytest.approx(LEAN * math.cos(turn) / 1.2e5 - 0.2, abs=1e-9)
    for ratio in (1.001 * mu, 2.0 * mu):
        crowd, turn = leaning(model, ratio, 8000)
        slide = TAU / MASS * LEAN * (math.sin(turn) - mu * math.cos(turn))
        np.testing.assert_allclose(crowd.velocity, [(0.0, slide)], rtol=0, atol=2e-6)


def test_a_run_resumed_while_people_stick_goes_on_to_the_bit(plugin_files, tmp_path):
    change = {"contact.model": "tangential_spring", "simulation.duration": 6.0, "output.animation": False}
    case = evac.load("square_room", change, plugin_files=[plugin_files["tangential_spring.py"]])
    whole = evac.Simulation(case)
    while not whole.ended:
        if whole.step == 300:
            middle = whole.state()
        whole.advance_tick()
    pairs, stretch = (middle[f"engine.memory.{name}"] for name in ("pairs", "numbers"))
    assert len(pairs) > 3
    assert np.abs(stretch).min() > 0.0
    resumed = evac.Simulation(case)
    resumed.restore(middle)
    while not resumed.ended:
        resumed.advance_tick()
    found, wanted = resumed.state(), whole.state()
    assert found.keys() == wanted.keys()
    for key, array in wanted.items():
        np.testing.assert_array_equal(found[key], array, err_msg=key)


def test_who_walks_along_a_wall_keeps_right(plugin_files):
    """Along +x: with a wall on the left by f tau / m, sideways, and at 0.3 m from one on the right."""
    force = class_of(plugin_files, "keep_right", "forces")()
    left = make_building(walls=[(-50, 0.8, 50, 0.8)])
    crowd = make_crowd([(0, 0)], speed=1.5, mass=80.0, tau=0.5)
    walk(Dem(), crowd, 30, explicit=False, building=left, forces=[force])
    drift = 60.0 * 0.5 / 80.0 * (1.0 - np.exp(-0.3 / 0.5))
    assert crowd.velocity[0, 1] == pytest.approx(-drift, rel=1e-12)
    right = make_building(walls=[(-50, -1.0, 50, -1.0)])
    crowd = make_crowd([(0, 0)], speed=1.5, mass=80.0, tau=0.5, radius=0.2)
    walk(Dem(), crowd, 2000, explicit=False, building=right, forces=[force])
    assert crowd.position[0, 1] == pytest.approx(-1.0 + 0.2 + 0.3, abs=1e-6)


@pytest.mark.parametrize(("name", "ticks"), [("jacobi", 20), ("plain", 4)])
def test_a_solver_in_a_file_finds_what_the_built_in_ones_find(plugin_files, name, ticks):
    exact = {
        "contact.model": "nsm1",
        "contact.nsm1.velocity_tolerance": 1e-9,
        "contact.nsm1.iterations": 100_000,
    }
    case = evac.load("square_room", exact, plugin_files=[plugin_files[f"{name}.py"]])
    simulation = evac.Simulation(case.change({"contact.nsm1.solver": name}))
    for _ in range(ticks):
        simulation.advance_tick()
    np.testing.assert_allclose(simulation.population.crowd.position, positions(case, ticks), rtol=0.0, atol=1e-7)
    report = simulation.engine.report()
    assert report["iterations"] > report["solves"] > 0
    assert report["retried_solves"] == 0


def test_what_a_solver_in_python_raises_is_told_with_its_place(plugin_files, tmp_path):
    text = plugin_files["plain.py"].read_text().replace("made = 0", "made = problem.nonsense")
    (tmp_path / "failing.py").write_text(text)
    changes = {"contact.model": "nsm1", "contact.nsm1.solver": "plain"}
    case = evac.load("square_room", changes, plugin_files=[tmp_path / "failing.py"])
    simulation = evac.Simulation(case)
    assert any(row.part == "solver plain" and "in Python" in row.why for row in simulation.plan)
    with pytest.raises(evac.PluginError, match=r"solver 'plain': AttributeError.*failing.py, line 15"):
        simulation.run()


def test_a_step_at_which_a_packing_is_unstable_is_refused(plugin_files):
    case = evac.load(
        "square_room",
        {"contact.model": "dem_numpy", "simulation.step": 0.02, "simulation.tick": 0.1},
        plugin_files=[plugin_files["dem_numpy.py"]],
    )
    with pytest.raises(evac.ScenarioError, match=r"simulation.step: .*'dem_numpy'"):
        evac.Simulation(case)


def test_crowding_slows_a_crowd_and_nobody_alone(plugin_files):
    case = evac.load("square_room", plugin_files=[plugin_files["crowding.py"]])
    slow = case.change({"behaviours.crowding": {"loss": 0.2}})
    assert evac.run(slow).last_out > evac.run(case).last_out + 1.0
    alone = {"people.people.number": 1}
    np.testing.assert_array_equal(positions(slow.change(alone), 10), positions(case.change(alone), 10))


def test_personal_space_keeps_people_apart(plugin_files):
    def least_distance(case):
        place = positions(case.change({"people.people.speed": 0.01}), 30)
        first, second = np.triu_indices(len(place), 1)
        return np.hypot(*(place[first] - place[second]).T).min()

    case = evac.load("square_room", plugin_files=[plugin_files["personal_space.py"]])
    assert least_distance(case.change({"forces.personal_space": {}})) > least_distance(case) + 0.05


def test_rooms_are_read_and_evacuated(plugin_files, tmp_path):
    (tmp_path / "a.rooms").write_text(
        "room hall 0 0 8 4\ntable a 2 2 3 3\nroom stage 8 0 10 4\nexit door 0 1 0 2\nlamp b 1 1 2 2\n"
    )
    case = evac.load(
        "square_room",
        {"building.mesh": str(tmp_path / "a.rooms"), "building.areas": [], "people.people.area": "stage"},
        plugin_files=[plugin_files["rooms.py"]],
    )
    check_plugin(case.registry.importers["rooms"], case)
    results = evac.run(case)
    assert results.evacuated == 20
    assert [level.polygon.area for level in results.building.levels] == [pytest.approx(39.0)]
    assert [(one.kind, one.level, one.place) for one in results.building.findings] == [
        ("left out", "floor", (1.0, 1.0))
    ]
    made = evac.import_building([tmp_path / "a.rooms"], tmp_path / "case", people=6, registry=case.registry)
    assert (made.fault, [room.name for room in made.rooms]) == ("", ["hall", "stage"])
    (tmp_path / "a.rooms").write_text("room hall 0 0 8\n")
    with pytest.raises(evac.BuildingError, match=r"a\.rooms: .*line 1: "):
        evac.Simulation(case)


def test_the_guard_counts_refuses_and_writes(plugin_files, tmp_path):
    case = evac.load("square_room", plugin_files=[plugin_files["crossing_guard.py"]])
    results = evac.run(case, tmp_path / "result")
    assert list(results.metrics.values()) == [{results.building.exits[0].name: 20}]
    table = np.loadtxt(tmp_path / "result" / "inside.csv", delimiter=",", skiprows=1)
    assert table[0].tolist() == [0.0, 20.0]
    assert (np.diff(table[:, 1]) <= 0).all()
    with pytest.raises(evac.ScenarioError, match="nobody is in at night"):
        evac.Simulation(case.change({"title": "a room by night"}))
