import math

import pytest

from evac.base.errors import PluginError
from evac.base.parameters import Configurable, Parameter


class Spring(Configurable):
    name = "spring"
    stiffness = Parameter(1.2e5, "stiffness", unit="kg/s2", above=0)
    sweeps = Parameter(10, "sweeps", minimum=1, maximum=100)
    reading = Parameter("isotropic", "reading", choices=("isotropic", "anisotropic"))
    warm = Parameter(True, "warm start")
    limit = Parameter(1.0, "limit", infinite=True)
    time = Parameter({"uniform": [0.0, 10.0]}, "time", unit="s", minimum=0, distribution=True)
    ways = Parameter((), "ways", choices=("north", "south"))
    names = Parameter((), "names")
    table = Parameter({}, "table")


class Damped(Spring):
    name = "damped"
    damping = Parameter(0.0, "damping", minimum=0)


def test_defaults_and_given_values_are_typed():
    spring = Spring(stiffness=200, sweeps=7)
    assert spring.stiffness == 200.0
    assert isinstance(spring.stiffness, float)
    assert spring.sweeps == 7
    assert spring.reading == "isotropic"
    assert spring.time.support() == (0.0, 10.0)
    assert (spring.ways, Spring(ways=["south", "north", "south"]).ways) == ((), ("south", "north"))


def test_a_subclass_declares_what_its_base_declares_first():
    assert list(Damped.declared()) == [*Spring.declared(), "damping"]
    assert list(Damped().values()) == list(Damped.declared())


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("stiffness", 0, "0 kg/s2.* 0"),
        ("stiffness", "hard", "number.*'hard'"),
        ("stiffness", True, "number.*True"),
        ("stiffness", math.inf, "inf"),
        ("limit", math.nan, "nan"),
        ("sweeps", 1.5, r"whole number.* 1\.5"),
        ("sweeps", math.inf, "inf"),
        ("sweeps", 0, "1.* 0"),
        ("sweeps", 101, "100.* 101"),
        ("reading", "isotropc", "'isotropc'.*'isotropic'"),
        ("warm", 1, "true or false.* 1"),
        ("time", -1, "0.* -1"),
        ("stifness", 1, "'stiffness'"),
        ("ways", ["north", "suth"], "'suth'.*'south'"),
        ("names", "north", "list.*'north'"),
        ("names", [1], r"list.*\[1\]"),
        ("table", [1], r"table.*\[1\]"),
    ],
)
def test_a_wrong_value_is_refused_with_key_and_range(key, value, words):
    with pytest.raises(PluginError, match=rf"^spring\.{key}: .*{words}"):
        Spring(**{key: value})


def test_infinity_is_legal_where_declared():
    assert Spring(limit=math.inf).limit == math.inf
