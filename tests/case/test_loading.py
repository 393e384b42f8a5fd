import json
import pickle
import re
import subprocess
import sys

import pytest

import evac
from evac.base.distributions import Distribution
from evac.base.errors import ScenarioError
from evac.case import case_from, load_case
from evac.simulation.assembly import make_behaviours, make_contact_model, make_forces
from tests.case.faults import lines_of, says


def test_a_case_holds_what_the_file_says_and_defaults_elsewhere(case_file, registry):
    case = load_case(case_file, registry=registry)
    pupils, teacher = case.people
    assert case.title == "Two groups in a room"
    assert (case.source, case.folder, case.mesh) == (case_file, case_file.parent, case_file.parent / "room.msh")
    assert (pupils.count, pupils.area) == (5, "desks")
    assert pupils.radius == Distribution("constant", (0.2,))
    assert pupils.speed_up.factor.mean() == 0.5
    assert (teacher.count, teacher.positions, teacher.level) == (1, ((1.0, 2.0),), "ground")
    assert (teacher.strategy, teacher.exits) == ("shortest", ())
    assert (case.simulation.step, case.simulation.tick, case.simulation.seed) == (0.01, 0.1, 3)
    assert case.directions.clearance is None
    assert case.building.model_dump(exclude={"mesh", "plan"}) == {
        "weld": 0.001, "flat_angle": 3.0, "walkable_angle": 50.0, "ramp": 0.125, "scale": 1.0, "up": "z",
        "headroom": 2.0, "treads": True, "north": None, "missing": (),
        "exits": (), "areas": (), "obstacles": (), "controls": {}, "moving": {}, "lifts": {}, "closed": (),
    }  # fmt: skip


def test_a_case_is_found_by_folder_and_by_shipped_name(case_file, registry, monkeypatch):
    assert load_case(case_file.parent, registry=registry).source == case_file
    monkeypatch.setitem(registry.cases, "two_groups", case_file.parent)
    assert load_case("two_groups", registry=registry).source == case_file
    with pytest.raises(ScenarioError, match=r"^two_group: .*'two_groups'"):
        load_case("two_group", registry=registry)
    with pytest.raises(ScenarioError, match=r"case\.toml"):
        load_case(case_file.parent.parent, registry=registry)


def test_plugins_are_made_with_their_parameters_in_the_order_of_the_file(case_file, registry, monkeypatch):
    case = load_case(case_file, registry=registry)
    model = make_contact_model(case)
    assert (model.name, model.stiffness) == ("soft", 500.0)
    assert make_contact_model(case.change(["contact.model=hard"])).solver == "gauss_seidel"
    (push,) = make_forces(case)
    assert push.strength == 100.0
    assert make_forces(case.change(["forces.push=false"])) == []
    assert [behaviour.name for behaviour in make_behaviours(case)] == ["wait"]
    both = case.change(["behaviours.follow=true"])
    assert [behaviour.name for behaviour in make_behaviours(both)] == ["wait", "follow"]
    monkeypatch.setattr(registry.behaviours["wait"], "acts_last", True)
    assert [behaviour.name for behaviour in make_behaviours(both)] == ["follow", "wait"]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("simulation.stp=0.1", "simulation.stp: unknown key; did you mean 'step'?"),
        ("duration=3", "duration: unknown key; it belongs to simulation: did you mean 'simulation.duration'?"),
        ("building.file=a.msh", "building.file: unknown key; did you mean 'mesh'?"),
        ("people.pupils.numbr=3", "people.pupils.numbr: unknown key; did you mean 'number'?"),
        ("people.0.number=2.5", "people.pupils.number: must be a valid integer, got 2.5"),
        ("simulation.duration=inf", "simulation.duration: must be a finite number, got inf"),
        ("simulation.no_progress=nan", "simulation.no_progress: must be greater than 0, got nan"),
        (
            "simulation.tick=0.035",
            "simulation.tick: 0.035 s is not a multiple of simulation.step 0.01 s; "
            "use tick = 0.03 or 0.04, or step = 0.00875 or 0.0116667",
        ),
        ("output.every=0.25", "output.every: 0.25 s is not a multiple of simulation.tick 0.1 s; use 0.2 or 0.3"),
        (
            "people.teacher.strategy=fastes",
            "people.teacher.strategy: must be 'shortest', 'fastest' or 'comfortable', got 'fastes'; "
            "did you mean 'fastest'?",
        ),
        (
            "people.pupils.speed={unifrm=[1, 2]}",
            "people.pupils.speed: unknown distribution 'unifrm'; did you mean 'uniform'?",
        ),
        ("people.pupils.speed_up={factor=-1}", "people.pupils.speed_up: must be at least 0, got -1"),
        (
            "people.pupils.speed_up={factor=1, minimum=0}",
            "people.pupils.speed_up: factor must be the only key; write { factor = { uniform = [0.4, 0.6] } }",
        ),
        (
            "people.pupils.mass={list=[60.0, 70.0]}",
            "people.pupils.mass: 2 values for 5 people; give one for each person",
        ),
        (
            "people.pupils.speed_up={factor={list=[1, 1, 1, 1, 1, 1]}}",
            "people.pupils.speed_up: 6 values for 5 people; give one for each person",
        ),
        ("people.teacher.number=2", "people.teacher.number: 2 people but 1 positions; remove number, or give an area"),
        ("people.teacher.velocity=[[1,0],[0,1]]",
         "people.teacher.velocity: 2 velocities for 1 positions; give one per position"),
        ("people.pupils.level=ground",
         "people.pupils.level: can be used only with positions, not with area and number; remove it"),
        ("people.teacher.name=pupils", "people.1.name: 'pupils' names two groups; rename one"),
        ("simulation=3", "simulation: must be a table, got 3"),
        ("building.plan='a.plan.toml'", "building.plan: must be a table; a file is named by mesh = 'a.plan.toml'"),
        ("building.flat_angle=60", "building.flat_angle: must be less than walkable_angle 50, got 60"),
        (
            'building.exits=[{name="door", segment=[[0,0],[0,0]], z=0}]',
            "building.exits.door.segment: its two ends are the same point [0.0, 0.0]; draw it along the door",
        ),
        (
            'building.areas=[{name="hall", polygon=[[0,0],[1,0],[1,1]]}]',
            "building.areas.hall.level: give the level by name, or its height z",
        ),
        ("people.pupils.number=1000001", "people.pupils.number: must be less than or equal to 1000000, got 1000001"),
        ("simulation.step=1e-9", "simulation.step: 1e-09 s gives 1e+08 steps in a tick of 0.1 s, more than 100,000; "
         "use a longer step or a shorter tick"),
        ("simulation.duration=0.004", "simulation.duration: 0.004 s is less than half of simulation.step 0.01 s, "
         "so that no step is made; use a longer duration"),
        ("contact.modle=soft", "contact.modle: unknown key; did you mean 'model'?"),
        ("contact.model=sofd", "contact.model: unknown contact model 'sofd'; did you mean 'soft'?"),
        ("contact.hrad.solver=cg", "contact.hrad: unknown contact model; did you mean 'hard'?"),
        ("contact.soft.stiffness=-1", "contact.soft.stiffness: must be greater than 0 N/m, got -1"),
        ("contact.hard.xyz=1",
         "contact.hard.xyz: 'hard' has no such parameter; known: solver"),
        ("forces.pusch.strength=1", "forces.pusch: unknown force; did you mean 'push'?"),
        ("behaviours.wait.time={uniform=[-1, 1]}", "behaviours.wait.time: must be at least 0, got -1"),
        ("people.pupils.behaviours.wait.shared=true",
         "people.pupils.behaviours.wait.shared: 'wait' has no such parameter; known: leader, time"),
        ("people.pupils.behaviours.wiat.time=2",
         "people.pupils.behaviours.wiat: unknown behaviour; did you mean 'wait'?"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line_with_file_key_and_fix(case_file, registry, override, line):
    (found,) = lines_of(case_file, [override], registry)
    assert says(found, case_file, line)
    assert found.endswith("override)")


@pytest.mark.parametrize(
    ("override", "line"),
    [
        (
            "people.pupils.positions=[[0,0]]",
            "people.pupils.area: give either area or positions, not both; remove one",
        ),
        (
            "people.teacher.z=0.0",
            "people.teacher.level: give the level of the positions by name, or its height z, not both",
        ),
        ("simulation.step=0.2", "simulation.tick: 0.1 s is not a multiple of simulation.step 0.2 s; "
         "use tick = 0.2 or 0.4, or step = 0.05 or 0.1"),
    ],
)  # fmt: skip
def test_keys_that_contradict_each_other_are_refused(case_file, registry, override, line):
    (found,) = lines_of(case_file, [override], registry)
    assert says(found, case_file, line)
    assert not found.endswith("override)")


def test_all_faults_are_reported_at_once(case_file, registry):
    overrides = ["simulation.stp=1", "contact.model=sofd", "people.pupil.number=3", "people.pupils.speed=-1"]
    assert [line.split(": ")[1] for line in lines_of(case_file, overrides, registry)] == [
        "people.pupil", "people.pupils.speed", "simulation.stp", "contact.model",
    ]  # fmt: skip


def test_a_setting_for_a_behaviour_not_in_use_is_refused_but_not_for_one_switched_off(case_file, registry):
    load_case(case_file, ["people.pupils.behaviours.follow.leader=teacher"], registry=registry)
    case_file.write_text(case_file.read_text().replace("follow = false", ""))
    (line,) = lines_of(case_file, ["people.pupils.behaviours.follow.leader=teacher"], registry)
    assert re.search(r"people\.pupils\.behaviours\.follow: .*\[behaviours\.follow\]", line)


def test_missing_files_are_named(case_file, registry):
    lines = lines_of(case_file, {"building.mesh": "rom.msh", "plugins.files": ["none.py"]}, registry)
    folder = case_file.parent
    assert lines == [
        f"{case_file}: plugins.files.0: no such file {folder / 'none.py'}; check the path (set by an override)",
        f"{case_file}: building.mesh: no such file {folder / 'rom.msh'}; check the path (set by an override)",
    ]


@pytest.mark.parametrize("content", [b"v 0 0 0\n", b"\x80\xff"])
def test_a_building_in_place_of_a_case_is_told(tmp_path, registry, content):
    path = tmp_path / "house.obj"
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"house\.obj: .* evac import .*house\.obj"):
        load_case(path, registry=registry)


def test_what_is_no_toml_is_refused_with_the_line(case_file, registry):
    case_file.write_text("title = \n")
    with pytest.raises(ScenarioError, match=r"case\.toml: .*line 1"):
        load_case(case_file, registry=registry)


def test_change_makes_another_checked_case_and_leaves_the_first(case_file, registry):
    case = load_case(case_file, registry=registry)
    other = case.change({"simulation.seed": 9, "people.pupils.number": 2})
    assert (case.simulation.seed, case.people[0].count) == (3, 5)
    assert (other.simulation.seed, other.people[0].count) == (9, 2)
    assert other.change(["title=new"]).simulation.seed == 9
    with pytest.raises(ScenarioError, match=r"simulation\.seed: .* 0"):
        case.change({"simulation.seed": -1})


def test_an_event_sends_people_to_exits_or_to_assembly_areas(case_file, registry):
    case = load_case(case_file, {"place": [{"name": "yard", "kind": "assembly", "area": "desks"}]}, registry=registry)
    for names in (["north", "south"], ["yard"], ["yard", "north"]):
        event = {"time": 1.0, "kind": "strategy", "target": "pupils", "value": names}
        if names != ["yard", "north"]:
            assert case.change({"event": [event]}).event[0].value == tuple(names)
            continue
        with pytest.raises(ScenarioError, match=r"event\.0\.value: "):
            case.change({"event": [event]})


def test_to_dict_is_complete_plain_and_makes_the_same_case_again(case_file, registry):
    case = load_case(case_file, registry=registry)
    table = json.loads(json.dumps(case.to_dict()))
    assert table["contact"] == {"model": "soft", "soft": {"stiffness": 500}, "hard": {"solver": "gauss_seidel"}}
    assert table["behaviours"]["follow"] is False
    assert table["behaviours"]["wait"] == {"time": {"uniform": [0.0, 10.0]}, "shared": True}
    assert table["people"][0]["radius"] == 0.2
    assert table["people"][0]["speed_up"] == {"factor": 0.5}
    assert table["people"][1]["radius"] == {"uniform": [0.2, 0.25]}
    again = case_from(table, case.source, registry=registry)
    assert again.to_dict() == case.to_dict()
    assert again.people == case.people


def test_a_case_travels_to_another_process(case_file, registry, monkeypatch):
    files = [row.origin for row in registry.provenance]
    monkeypatch.setattr("evac.contract.registry.Registry.__init__.__kwdefaults__", {"builtins": ()})
    case = load_case(case_file, ["simulation.seed=8"], plugin_files=files, registry=registry)
    copy = pickle.loads(pickle.dumps(case))
    assert copy.to_dict() == case.to_dict()
    assert copy.simulation.seed == 8


def test_frozen(case_file, registry):
    case = load_case(case_file, registry=registry)
    with pytest.raises(ValueError, match="frozen"):
        case.simulation.seed = 4


def test_importing_pulls_in_nothing_heavy():
    heavy = "numba", "scipy", "shapely", "pyvista", "matplotlib", "meshio"
    code = f"import sys, evac.case; print([name for name in {heavy} if name in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_a_plan_in_memory_becomes_data_of_the_case():
    import pickle

    import shapely

    from evac.building.plan.plan import Plan

    plan = Plan()
    plan.storey("room", shapely.box(0, 0, 6, 4))
    plan.exit("door", "room", [(0, 1), (0, 2)])
    people = [{"name": "people", "level": "room", "number": 3}]
    table = {"building": plan, "people": people, "contact": {"model": "nsm2"}}
    case = load_case(table)
    assert case.mesh is None
    assert case.building.plan["exits"] == [{"name": "door", "storey": "room", "segment": [[0.0, 1.0], [0.0, 2.0]]}]
    assert pickle.loads(pickle.dumps(case)).to_dict() == case.to_dict()
    closed = load_case({**table, "building": {"plan": plan, "weld": 0.002}})
    assert (closed.building.plan, closed.building.weld) == (case.building.plan, 0.002)
    assert isinstance(table["building"], Plan)


@pytest.mark.parametrize("building", [{}, {"mesh": "a.msh", "plan": {}}])
def test_a_building_is_given_in_one_way(building):
    with pytest.raises(ScenarioError, match=r"building\.mesh"):
        load_case({"building": building, "people": [], "contact": {"model": "nsm2"}})


def test_a_level_alone_is_where_people_start():
    people = [{"name": "people", "level": "room", "number": 20}]
    case = load_case("square_room", {"people": people})
    assert (case.people[0].level, case.people[0].count) == ("room", 20)
    with pytest.raises(ScenarioError, match=r"people\.people\.number"):
        case.change({"people": [{"name": "people", "level": "room"}]})


def test_a_dose_without_conditions_is_refused(case_file):
    with pytest.raises(ScenarioError, match=r"dose: .*\[\[conditions\]\]"):
        load_case(case_file, {"dose": {"heat": "none"}})


def test_a_case_that_is_written_elsewhere_finds_its_files(tmp_path):
    case = evac.load("primary_school").change({"conditions": [{"source": "fds", "file": "smoke/office.smv"}]})
    (tmp_path / "a" / "b").mkdir(parents=True)
    case.write(tmp_path / "a" / "b" / "case.toml")
    again = evac.load(tmp_path / "a" / "b" / "case.toml")
    assert again.mesh.samefile(case.mesh)
    assert again.building.mesh != case.building.mesh
    assert (again.folder / again.conditions[0].file).resolve() == (case.folder / "smoke" / "office.smv").resolve()


def test_a_key_that_a_program_gives_as_none_is_written_as_one_not_given(tmp_path):
    plan = evac.Plan()
    plan.storey("hall", [(0, 0), (8, 0), (8, 6), (0, 6)])
    plan.exit("door", "hall", [(0, 2), (0, 4)])
    people = {"name": "people", "number": 3, "level": "hall", "preset": None}
    given = {"building": {"mesh": None, "plan": plan}, "people": [people], "contact": {"model": "nsm2"}}
    evac.load(given).write(tmp_path / "case.toml")
    assert "inf" not in (tmp_path / "case.toml").read_text()
    assert evac.load(tmp_path).to_dict() == evac.load(given).to_dict()


@pytest.mark.parametrize(
    ("keys", "places"),
    [
        ({"values": {"co": 2e6}}, ["values.co"]),
        ({"values": {"co": float("nan"), "o2": [1.0, "x"]}}, ["values.co", "values.o2.1"]),
        ({"values": {"co": 1.0}, "level": 5}, ["level"]),
        ({"values": {"co": 1.0}, "level": [5, "g", 6]}, ["level.0", "level.2"]),
    ],
)
def test_a_value_that_may_be_one_or_a_list_has_one_fault_with_its_key(keys, places):
    case = evac.load("square_room")
    with pytest.raises(ScenarioError) as caught:
        case.change({"conditions": [{"source": "prescribed", **keys}]})
    told = [line.split("conditions.0.")[1].split(":")[0] for line in str(caught.value).splitlines()]
    assert told == places
