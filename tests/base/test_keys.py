"""Tables of keys: what is wrong is told with its key, what it got, and how to fix it."""

from typing import Annotated, Literal

import numpy as np
import pytest
from pydantic import Field, ValidationError, model_validator

from evac.base.errors import ScenarioError
from evac.base.keys import (
    Factor,
    Name,
    Parameters,
    Point,
    Radius,
    Real,
    StairSpeed,
    Switch,
    Table,
    Whole,
    faults_of,
    is_multiple,
    key,
    table_at,
    with_own_classes,
    wrong,
)


class Way(Table):
    """A table in a list of tables."""

    name: Name = key("name of the way")
    ends: tuple[Point, ...] = key("its ends", "m", min_length=2)
    width: Real | None = key("its width", "m", None, gt=0.0)


class Options(Table):
    """A table beside another one."""

    picture: Switch = key("whether a picture is drawn", default=True)
    number: Whole = key("a number", default=1, ge=1, le=5)


class Root(Table):
    """A file with one table, a list of tables and named tables."""

    mesh: str = key("file of the building")
    kind: Literal["dem", "nsm1"] = key("the model", default="dem")
    ways: Annotated[tuple[Way, ...], Field(alias="way")] = key("ways", default=())
    options: Options = key("options", default=Options())
    presets: dict[str, Options] = key("named options", default={})
    radius: Radius | None = key("body radius", "m", default=None)
    stair: StairSpeed | None = key("speed on stairs", "m/s", default=None)
    behaviour: Parameters = key("a behaviour", default=False)


class Range(Table):
    """A table whose keys depend on each other."""

    least: Whole
    most: Whole

    @model_validator(mode="after")
    def _ordered(self):
        if self.most <= self.least:
            raise wrong("most", f"must be more than least; use {self.least + 1}")
        return self


WAY = {"name": "out", "ends": [[0.0, 0.0], [1.0, 0.0]]}


@pytest.mark.parametrize(
    ("given", "at", "words"),
    [
        ({}, ("mesh",), "missing; give file of the building"),
        ({"mash": "a.obj"}, ("mash",), "unknown key; did you mean 'mesh'?"),
        ({"file": "a.obj"}, ("file",), "unknown key; did you mean 'mesh'?"),
        ({"picture": True}, ("picture",), "unknown key; it belongs to options: did you mean 'options.picture'?"),
        ({"mesh": 3}, ("mesh",), "must be a valid string, got 3"),
        ({"kind": "nsm"}, ("kind",), "must be 'dem' or 'nsm1', got 'nsm'; did you mean 'nsm1'?"),
        ({"options": 3}, ("options",), "must be a table, got 3"),
        ({"options": {"number": 6}}, ("options", "number"), "must be less than or equal to 5, got 6"),
        ({"options": {"number": 1.0}}, ("options", "number"), "must be a valid integer, got 1.0"),
        ({"options": {"picture": 1}}, ("options", "picture"), "must be a valid boolean, got 1"),
        ({"presets": {"a": {"nummer": 2}}}, ("presets", "a", "nummer"), "unknown key; did you mean 'number'?"),
        ({"way": WAY}, ("way",), "must be a list, got {'ends': [[0.0, 0.0], [1.0, 0.0]], 'name': 'out'}; "
         "write its header in double brackets: [[...]]"),
        ({"way": "out"}, ("way",), "must be a list, got 'out'; write way = [\"out\"]"),
        ({"way": [WAY | {"ends": [[0.0, 0.0]]}]}, ("way", 0, "ends"), "must have at least 2 items"),
        ({"way": [WAY | {"ends": [[0, 0], [1, "x"]]}]}, ("way", 0, "ends", 1, 1), "must be a valid number, got 'x'"),
        ({"way": [WAY | {"ends": [[0, 0], [1, 1e9]]}]}, ("way", 0, "ends", 1, 1), "must be less than or equal to"),
        ({"way": [WAY | {"width": 0.0}]}, ("way", 0, "width"), "must be greater than 0, got 0.0"),
        ({"way": [WAY | {"width": float("nan")}]}, ("way", 0, "width"), "must be a finite number"),
        ({"way": [WAY | {"name": ""}]}, ("way", 0, "name"), "must have at least 1 character"),
        ({"way": [WAY | {"name": "a\nb"}]}, ("way", 0, "name"), "must be one line without control characters"),
        ({"radius": -0.1}, ("radius",), "-0.1"),
        ({"stair": {"factor": 0.5, "uniform": [0, 1]}}, ("stair",), "factor must be the only key"),
        ({"behaviour": 2}, ("behaviour",), "must be a table of parameters, or false to switch it off, got 2"),
    ],
)  # fmt: skip
def test_a_fault_names_its_key_and_the_remedy(given, at, words):
    given = given if not given or set(given) & {"mesh", "mash", "file"} else {"mesh": "a.obj", **given}
    with pytest.raises(ValidationError) as caught:
        Root.model_validate(given)
    faults = [fault for fault in faults_of(caught.value, Root) if fault.key == at]
    assert len(faults) == 1
    assert words in faults[0].text


def test_only_the_first_fault_is_raised_from_python_with_its_place():
    given = {"mesh": "a.obj", "options": {"number": 9}, "radius": -1.0}
    with pytest.raises(ScenarioError, match=r"^case\.options\.number: must be less than or equal to 5, got 9$"):
        Root.read(given, ScenarioError, "case.")
    with pytest.raises(ScenarioError, match=r"^range\.most: must be more than least; use 3$"):
        Range.read({"least": 2, "most": 1}, ScenarioError, "range.")


def test_values_from_python_are_those_of_a_file():
    class Word(str):
        """A string of a script."""

    ends = np.array([[0.0, 0.0], [1.0, 0.0]])
    root = Root.read({"mesh": Word("a.obj"), "way": [{"name": "out", "ends": ends}]}, ScenarioError, "")
    assert root.ways[0].ends == ((0.0, 0.0), (1.0, 0.0))
    assert type(root.mesh) is str
    assert with_own_classes({"a": (np.int64(3), np.bool_(True))}) == {"a": [3, True]}
    assert Root.read({"mesh": "a", "behaviour": True}, ScenarioError, "").behaviour == {}
    stair = Root.read({"mesh": "a", "stair": {"factor": 0.5}}, ScenarioError, "").stair
    assert isinstance(stair, Factor)
    assert stair.to_value() == {"factor": 0.5}


def test_the_table_of_a_key():
    assert table_at((), Root) is Root
    assert table_at(("ways", 0), Root) is Way
    assert table_at(("presets", "any"), Root) is Options
    assert table_at(("mesh", "x"), Root) is None


@pytest.mark.parametrize(("value", "unit", "expected"), [(0.3, 0.1, True), (0.25, 0.1, False), (0.04, 0.1, False)])
def test_multiples(value, unit, expected):
    assert is_multiple(value, unit) == expected
