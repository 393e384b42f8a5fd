"""JSON schemas accept what evac accepts, and refuse by key and type what it refuses."""

import copy
import json
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
from jsonschema import Draft7Validator, Draft202012Validator

from evac.base.errors import BuildingError, ScenarioError
from evac.building.plan.plantable import plan_of
from evac.case.case import Case
from evac.case.jsonschema import case_schema, plan_schema
from evac.case.loading import case_from
from evac.contract.registry import Registry

REGISTRY = Registry()
CASES = sorted(REGISTRY.cases)

#: Cases with other keys than those of the others.
MIXED = ("classroom", "office_fire", "square_room")
EXAMPLE = files("evac.importing") / "example" / "house.plan.toml"

#: Values of other types.
WRONG = ({"nonsense": 1}, [[[]]], True, "nonsense")

#: Keys whose value is the name of a file or of something else in the case.
NAMES = ("mesh", "preset")


@pytest.fixture(scope="module")
def of_case():
    return Draft7Validator(case_schema(REGISTRY))


@pytest.fixture(scope="module")
def of_plan():
    return Draft7Validator(plan_schema())


def content(name):
    path = REGISTRY.cases[name]
    return tomllib.loads((path / "case.toml").read_text(encoding="utf-8")), path


def places(value, where=()):
    """The paths to all values of a table."""
    if where[:2] == ("building", "plan"):
        return
    yield where
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*where, key))


def changed(table, where, value):
    table = copy.deepcopy(table)
    inner = table
    for key in where[:-1]:
        inner = inner[key]
    inner[where[-1]] = value
    return table


def refused(table, folder):
    try:
        case_from(table, folder / "case.toml", registry=REGISTRY)
    except ScenarioError:
        return True
    return False


def test_schemas_are_valid(of_case, of_plan):
    for validator in (of_case, of_plan):
        Draft7Validator.check_schema(validator.schema)
        json.dumps(validator.schema, allow_nan=False)


@pytest.mark.parametrize("name", CASES)
def test_shipped_cases_are_accepted(name, of_case):
    for validator in (of_case, Draft202012Validator(Case.model_json_schema())):
        assert not list(validator.iter_errors(content(name)[0]))


@pytest.mark.parametrize("path", [EXAMPLE, Path(__file__).parents[2] / "docs/examples/house.plan.toml"])
def test_plans_of_new_cases_and_of_the_documents_are_accepted(path, of_plan):
    assert not list(of_plan.iter_errors(tomllib.loads(path.read_text(encoding="utf-8"))))


@pytest.mark.parametrize("name", MIXED)
def test_keys_and_types_are_refused_where_evac_refuses_them(name, of_case):
    """All keys but the plan, which is read with the building."""
    table, folder = content(name)
    for where in places(table):
        inner = table
        for key in where:
            inner = inner[key]
        changes = [((*where, "nonsense"), 1)] if isinstance(inner, dict) else []
        changes += [(where, value) for value in WRONG] if where and where[-1] not in NAMES else []
        for place, value in changes:
            wrong = changed(table, place, value)
            assert of_case.is_valid(wrong) is not refused(wrong, folder), (place, value)


@pytest.mark.parametrize("name", MIXED)
def test_numbers_beyond_their_bounds_are_refused_by_evac_if_by_the_schema(name, of_case):
    table, folder = content(name)
    for where in list(places(table))[1:]:
        wrong = changed(table, where, -1e300)
        assert of_case.is_valid(wrong) or refused(wrong, folder), where


def test_plans_are_refused_by_key_and_type_as_evac_refuses_them(of_plan):
    square = [[0, 0], [9, 0], [9, 9], [0, 9]]
    plan = {
        "storeys": [{"name": "ground", "polygons": square}],
        "doors": [{"name": "in", "storey": "ground", "segment": [[4, 0], [4, 9]], "outside": "refuse"}],
        "exits": [{"name": "out", "storey": "ground", "segment": [[1, 0], [3, 0]]}],
    }
    assert of_plan.is_valid(plan)
    plan_of(plan, Path("plan"), Path())
    wrong = [
        changed(plan, ("exits", 0, "widht"), 1.0),
        changed(plan, ("exits", 0, "name"), 3),
        changed(plan, ("storeys", 0, "z"), "high"),
        changed(plan, ("doors",), {"name": "in"}),
        changed(plan, ("elevators",), []),
        {**plan, "exits": [{"name": "out"}]},
    ]
    for table in wrong:
        assert not of_plan.is_valid(table)
        with pytest.raises(BuildingError):
            plan_of(table, Path("plan"), Path())
