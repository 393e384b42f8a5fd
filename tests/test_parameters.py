import math

import pytest

from evac.errors import PluginError
from evac.parameters import Configurable, Parameter, did_you_mean


class Spring(Configurable):
    name = "spring"
    stiffness = Parameter(1.2e5, "stiffness", unit="kg/s2", above=0)
    sweeps = Parameter(10, "sweeps", minimum=1, maximum=100)
    reading = Parameter("isotropic", "reading", choices=("isotropic", "anisotropic"))
    warm = Parameter(True, "warm start")
    limit = Parameter(1.0, "limit", infinite=True)
    time = Parameter({"uniform": [0.0, 10.0]}, "time", unit="s", minimum=0, distribution=True)


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


def test_a_subclass_declares_what_its_base_declares_first():
    assert list(Damped.declared()) == [*Spring.declared(), "damping"]
    assert list(Damped().values()) == list(Damped.declared())


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("stiffness", 0, "spring.stiffness: must be greater than 0 kg/s2, got 0"),
        ("stiffness", "hard", "spring.stiffness: expected a number, got 'hard'"),
        ("stiffness", True, "spring.stiffness: expected a number, got True"),
        ("stiffness", math.inf, "spring.stiffness: must be finite, got inf"),
        ("limit", math.nan, "spring.limit: must be finite, got nan"),
        ("sweeps", 1.5, "spring.sweeps: expected a whole number, got 1.5"),
        ("sweeps", math.inf, "spring.sweeps: must be finite, got inf"),
        ("sweeps", 0, "spring.sweeps: must be at least 1, got 0"),
        ("sweeps", 101, "spring.sweeps: must be at most 100, got 101"),
        ("reading", "isotropc", "spring.reading: unknown value 'isotropc'; did you mean 'isotropic'?"),
        ("warm", 1, "spring.warm: expected true or false, got 1"),
        ("time", -1, "spring.time: must be at least 0, got -1"),
        ("stifness", 1, "spring.stifness: 'spring' has no such parameter; did you mean 'stiffness'?"),
    ],
)
def test_a_wrong_value_is_refused_with_key_and_range(key, value, message):
    with pytest.raises(PluginError) as caught:
        Spring(**{key: value})
    assert str(caught.value) == message


def test_infinity_is_legal_where_declared():
    assert Spring(limit=math.inf).limit == math.inf


def test_did_you_mean_lists_what_is_known_when_nothing_is_close():
    assert did_you_mean("xyz", ("dem", "nsm2")) == "known: dem, nsm2"
    assert did_you_mean("xyz", ()) == "known: none"
