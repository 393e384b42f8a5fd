"""Every number of a case has bounds, and what would take too much memory or time is refused by its key."""

import pytest
from annotated_types import Ge, Gt, Le, Lt

import evac
from evac.base.errors import BuildingError, ScenarioError
from evac.case.case import Case
from evac.case.schema import SimulationSettings
from evac.contract.registry import Registry

REGISTRY = Registry()


def _numbers(table):
    """Yield the tables' keys that are numbers, with their bounds."""
    from evac.base.change import REMEDIES, is_legal
    from evac.base.keys import table_of

    for name, field in table.model_fields.items():
        inner = table_of(field.annotation)
        if inner is not None:
            yield from _numbers(inner)
        elif f"{table.__name__}.{name}" == "EventSettings.value":
            assert not any(is_legal(kind, value) for kind in REMEDIES for value in (-1e9, 1e9))  # bounds of each kind
        elif "float" in str(field.annotation) or "int" in str(field.annotation):
            yield f"{table.__name__}.{name}", field


def test_every_number_has_a_lower_and_an_upper_bound():
    found = list(_numbers(Case))
    assert len(found) > 15
    for name, field in found:
        text = f"{field.metadata} {field.annotation}"
        # Nobody waits for longer than a run lasts; never to wait is legal.
        kinds = (Ge, Gt, Le, Lt)
        assert any(kind.__name__ + "(" in text for kind in kinds[:2]), name
        assert any(kind.__name__ + "(" in text for kind in kinds[2:]) or name.endswith("no_progress"), name


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("directions.clearance", 100.0),
        ("directions.spacing", 0.001),
        ("directions.spacing", 5e-324),
        ("simulation.step", 5e-324),
        ("simulation.tick", 1e300),
        ("output.every", 1e-9),
        ("people.people.number", 1_000_000),
        ("people.people.mass", 1e300),
        ("people.people.mass", {"lognormal": [11.0, 3.0]}),
        ("people.people.speed", {"uniform": [1.0, 1e6]}),
        ("people.people.speed_up", {"factor": 1e9}),
        ("building.scale", 1e300),
        ("contact.nsm2.iterations", 10**18),
    ],
    ids=str,
)
def test_what_cannot_be_meant_is_refused_by_its_key(key, value):
    changes = {key: value} | ({"output.every": 0.1} if key == "simulation.tick" else {})
    with pytest.raises(ScenarioError, match=key.replace(".", r"\.")):
        evac.Simulation(evac.load("square_room", changes, registry=REGISTRY), will_run=False)


def test_a_building_larger_than_any_is_refused():
    with pytest.raises(BuildingError, match=r"building\.scale"):
        evac.Simulation(evac.load("square_room", {"building.scale": 1e6}, registry=REGISTRY), will_run=False)


@pytest.mark.parametrize(
    ("step", "tick", "duration", "steps"), [(0.1, 0.3, 0.7, (3, 7)), (0.01, 0.29, 1.13, (29, 113))]
)
def test_numbers_of_steps_are_rounded_as_floats_divide(step, tick, duration, steps):
    settings = SimulationSettings(step=step, tick=tick, duration=duration)
    assert (settings.steps_per_tick, settings.last_step) == steps
