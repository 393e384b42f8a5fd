"""Random walking: extreme people, parameters, contact models and strategies; a run is killed and resumed.

Everybody stays on the floor at a possible speed, and a run that was resumed, or
that has all parts (``full``), gives the same bits.
"""

import random
from typing import Any

import numpy as np
import pytest

import evac
from evac.base.defaults import MOST_SPEED
from evac.base.errors import ScenarioError, SimulationError
from evac.case.schema import QuickestSettings
from evac.contract.registry import Registry
from tests.properties.seeded import MODELS, drawn
from tests.properties.twice import KINDS, made_again


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
@drawn(1)
def test_people_stay_on_the_floor_and_a_run_made_again_has_the_same_bits(kind, seed, tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("walk")
    generator = random.Random(f"{kind}-{seed}")
    try:
        loaded = evac.load(table_of(generator))
        one = evac.run(loaded, tmp_path / "one", progress=False)
    except ScenarioError:
        return
    except SimulationError as error:  # of a step that cannot be made
        said = str(error)
        assert "t = " in said, said
        assert "\n" not in said, said
        return
    check(one)
    made_again(kind, loaded, one, tmp_path, generator)


def check(results: Any) -> None:
    """Check that people move as people can, on the floor."""
    trajectory = results.trajectory
    corners = trajectory.building.vertices[:, :2]
    for k in range(len(trajectory)):
        frame = trajectory[k]
        assert (frame["position"] > corners.min(axis=0)).all(), frame["time"]
        assert (frame["position"] < corners.max(axis=0)).all(), frame["time"]
        assert (frame["speed"] <= MOST_SPEED).all(), frame["time"]
        assert np.isfinite(frame["contact_force"]).all(), frame["time"]
    crowd = results.crowd
    assert np.isfinite(crowd.contact_force).all()
    assert (np.isfinite(crowd.exit_time) == (crowd.level < 0)).all()


def table_of(generator: random.Random) -> dict[str, Any]:
    """Return a case: one or two storeys, groups of any size, and behaviours with values at their bounds."""
    wide, deep, slot = generator.uniform(5.0, 9.0), generator.uniform(4.0, 7.0), generator.choice([0.6, 0.9, 1.6])
    floor, names = [[0, 0], [wide, 0], [wide, deep], [0, deep]], ["ground", "first"][: generator.choice([1, 2])]
    plan: dict[str, Any] = {
        "storeys": [{"name": name, "z": 2.5 * k, "polygons": [floor]} for k, name in enumerate(names)],
        "exits": [
            {"name": "main", "storey": "ground", "segment": [[0, 2.5], [0, 2.5 + slot]]},
            {"name": "back", "storey": "ground", "segment": [[wide, 1.0], [wide, 1.0 + slot]]},
        ][: generator.choice([1, 2])],
    }
    if len(names) == 2:
        stair = {"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first"}
        plan["stairs"] = [stair | {"length": 3.9, "direction": [1, 0]}]
    used = behaviours(generator)
    return {
        "building": {"plan": plan},
        "people": [people(generator, name, used) for name in names],
        "contact": {"model": generator.choice(MODELS)},
        "directions": {"spacing": 0.25, "quickest": extremes(generator, bounds_of_quickest(), 0.5)},
        "behaviours": used,
        "simulation": {"duration": generator.choice([2.0, 5.03]), "tick": generator.choice([0.05, 0.1, 0.5])},
        "output": {"picture": False, "animation": False, "every": 0.5},
    }


def people(generator: random.Random, level: str, used: dict[str, Any]) -> dict[str, Any]:
    """Return a group."""
    number = generator.choice([1, 1, 2, 12, 25])
    group: dict[str, Any] = {"name": level, "number": number, "level": level}
    group["strategy"] = generator.choice(["fastest", "shortest", "comfortable", "quickest", "quickest"])
    group["radius"] = generator.choice([0.01, 0.05, 0.2, 0.25, {"uniform": [0.1, 0.4]}])
    group["speed"] = generator.choice([0.0, 1e-6, 0.8, 1.4, 5.0, {"uniform": [0.1, 3.0]}])
    group["tau"] = generator.choice([0.01, 0.3, 50.0])
    group["mass"] = generator.choice([0.001, 70.0, 80.0, 1e5])
    own = {}
    if "walking" in used and generator.random() < 0.4:
        own["walking"] = {"chest_depth": generator.choice([0.02, 0.1, 0.28, 2.0])}
    group["behaviours"] = own
    if generator.random() < 0.2:
        group |= {"turns": False, "steepest": generator.choice([0.0, 0.5, 2.0])}
    return group


def behaviours(generator: random.Random) -> dict[str, Any]:
    """Return walking, headway or both, with some parameters at their bounds, among other behaviours."""
    registry, found = Registry(), {}
    for name in generator.choice([["walking"], ["walking"], ["walking"], ["headway"], ["headway", "walking"]]):
        bounds = {
            key: (parameter.above if parameter.minimum is None else parameter.minimum, parameter.maximum)
            for key, parameter in registry.behaviours[name].declared().items()
            if not parameter.choices
        }
        found[name] = extremes(generator, bounds, generator.choice([0.0, 0.1, 0.5]))
    if generator.random() < 0.3:
        found["route_choice"] = {"every": 0.5}
    if generator.random() < 0.3:
        found["response_time"] = {"time": generator.choice([0.0, 1.0, 1e9])}
    return found


def extremes(generator: random.Random, bounds: dict[str, Any], share: float) -> dict[str, float]:
    """Return a share of the keys with values at, near or between their bounds."""
    found = {}
    for key, (low, high) in bounds.items():
        if generator.random() < share:
            middle = generator.uniform(low, high)
            found[key] = generator.choice([max(low, 1e-9), low + 1e-3 * (high - low), high, middle])
    return found


def bounds_of_quickest() -> dict[str, Any]:
    """Return the bounds of each key of `[directions.quickest]`."""
    bounds = {}
    for key, field in QuickestSettings.model_fields.items():
        low = next(item.ge for item in field.metadata if hasattr(item, "ge"))
        bounds[key] = (low, next(item.le for item in field.metadata if hasattr(item, "le")))
    return bounds
