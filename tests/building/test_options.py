import numpy as np
import pytest

from evac import BuildingError, Plan, ScenarioError, import_building
from evac.case import load_case


@pytest.fixture
def room(mesh):
    return mesh.rectangle(0, 0, 6, 4)


@pytest.mark.parametrize(
    ("key", "value"),
    [("weld", 2.0), ("scale", np.inf), ("headroom", -1.0), ("up", "x"), ("treads", 1), ("walkable_angle", 90.0)],
)
def test_an_option_has_the_same_bounds_in_a_case_from_python_and_in_an_import(room, tmp_path, read, key, value):
    named = rf"building\.{key}: "
    with pytest.raises(BuildingError, match=named):
        read(room, **{key: value})
    with pytest.raises(ScenarioError, match=named):
        load_case("square_room", {f"building.{key}": value})
    with pytest.raises(ScenarioError, match=f"option {key}: "):
        import_building([tmp_path / "mesh.obj"], tmp_path / "case", options={key: value})


def test_a_plan_takes_the_options_of_a_file():
    plan = Plan()
    plan.storey("ground", [(0, 0), (6, 0), (6, 4), (0, 4)])
    out = {"name": "out", "segment": [(6, 1), (6, 2)], "level": "ground"}
    assert [way.name for way in plan.building(exits=[out]).exits] == ["out"]
    assert plan.building(need_exit=False).exits == ()


@pytest.mark.parametrize(("given", "ends"), [({}, "its height z"), ({"level": "floor z=0.00", "z": 0.0}, "not both")])
def test_a_level_is_given_by_name_or_by_height(room, read, given, ends):
    with pytest.raises(BuildingError, match=rf"building\.exits\.0\.level: give the level by name, or .*{ends}$"):
        read(room, exits=[{"name": "out", "segment": [[6, 1], [6, 2]], **given}])
