import math

import numpy as np
import pytest
from scipy import integrate, stats

from evac.base.distributions import (
    Distribution,
    as_text,
    generator_for,
    generator_state,
    parse,
    restore_generator,
)
from evac.base.errors import ScenarioError

N = 20_000

CASES = {
    "uniform": ({"uniform": [0.2, 0.25]}, stats.uniform(0.2, 0.05)),
    "normal": ({"normal": [1.3, 0.2]}, stats.norm(1.3, 0.2)),
    "lognormal": ({"lognormal": [0.5, 0.4]}, stats.lognorm(0.4, scale=math.exp(0.5))),
    "weibull": ({"weibull": [1.8, 2.5]}, stats.weibull_min(1.8, scale=2.5)),
    "gamma": ({"gamma": [2.2, 1.5]}, stats.gamma(2.2, scale=1.5)),
}


def truncated_law(law, low, high):
    """Distribution function and mean of a scipy law truncated to [low, high], by quadrature."""
    share = law.cdf(high) - law.cdf(low)
    mean = integrate.quad(lambda x: x * law.pdf(x), low, high)[0] / share
    return lambda x: np.clip((law.cdf(x) - law.cdf(low)) / share, 0, 1), mean


@pytest.mark.parametrize("name", CASES)
def test_draws_follow_the_law_and_mean_is_exact(name):
    table, law = CASES[name]
    distribution = parse(table, "key")
    values = distribution.draw(generator_for(1, name), N)
    assert stats.kstest(values, law.cdf).pvalue > 0.01
    assert distribution.mean() == pytest.approx(law.mean(), rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_a_truncated_distribution_is_that_of_what_lies_inside(name):
    table, law = CASES[name]
    low, high = float(law.ppf(0.3)), float(law.ppf(0.9))
    distribution = parse(table | {"minimum": low, "maximum": high}, "key")
    values = distribution.draw(generator_for(2, name), N)
    cdf, mean = truncated_law(law, low, high)
    assert distribution.support() == (low, high)
    assert values.min() >= low
    assert values.max() <= high
    assert stats.kstest(values, cdf).pvalue > 0.01
    assert distribution.mean() == pytest.approx(mean, rel=1e-7)
    shares = np.linspace(0.05, 0.95, 19)
    np.testing.assert_allclose(cdf(distribution.quantiles(shares)), shares, atol=1e-9)


def test_a_bound_on_one_side():
    distribution = parse({"normal": [0.0, 1.0], "minimum": 0.0}, "key")
    assert distribution.mean() == pytest.approx(math.sqrt(2 / math.pi), rel=1e-12)
    assert parse({"lognormal": [0.0, 1.0], "maximum": 1.0}, "key").support() == (0.0, 1.0)


def test_a_number_is_a_constant():
    assert parse(3, "key") == Distribution("constant", (3.0,))
    assert parse({"constant": 3}, "key").draw(generator_for(0), 4).tolist() == [3.0] * 4
    assert parse(3, "key").quantiles(np.array([0.1, 0.9])).tolist() == [3.0, 3.0]


def test_a_list_is_taken_in_order_and_must_be_long_enough():
    distribution = parse({"list": [3, 1, 2]}, "key")
    assert distribution.draw(generator_for(0), 2).tolist() == [3.0, 1.0]
    assert distribution.mean() == 2.0
    assert distribution.support() == (1.0, 3.0)
    with pytest.raises(ScenarioError, match=r"3 .* 4"):
        distribution.draw(generator_for(0), 4)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("fast", "number.*'fast'"),
        (True, "number.*True"),
        (math.inf, "finite.*inf"),
        ({"uniform": [0, math.nan]}, "high of uniform.*nan"),
        ({"unifrom": [0, 1]}, "'unifrom'.*'uniform'"),
        ({"minimun": 0, "constant": 1}, "'minimun'.*'minimum'"),
        ({}, "constant, uniform, normal, lognormal, weibull, gamma, list; .*none"),
        ({"uniform": [0, 1], "constant": 1}, "; .*uniform, constant"),
        ({"uniform": 3}, r"uniform = \[low, high\].* 3"),
        ({"normal": [1, 2, 3]}, r"normal = \[mean, standard deviation\].* 3 numbers"),
        ({"uniform": [1, 1]}, r"uniform = \[low, high\].*low < high.*\[1, 1\]"),
        ({"normal": [1, 0]}, "standard deviation of normal.* 0"),
        ({"gamma": [-1, 2]}, "shape of gamma.* -1"),
        ({"lognormal": {"mean": 60}}, r"mean = .*deviation = .*\[mu, sigma\]"),
        ({"lognormal": {"mean": -60, "deviation": 20}}, "mean of lognormal.* -60"),
        ({"lognormal": {"mean": 60, "deviation": "long"}}, "deviation of lognormal.*'long'"),
        ({"lognormal": {"mean": 1e-300, "deviation": 1e300}}, "mean of lognormal"),
        ({"list": []}, "list"),
        ({"list": [1, "a"]}, "value 1 of list.*'a'"),
        ({"constant": 3, "maximum": 2}, r"3 .*\[-inf, 2\]"),
        ({"normal": [0, 1], "minimum": 2, "maximum": 1}, "minimum 2.* maximum 1"),
        ({"normal": [0, 1], "minimum": 9}, r"normal.*\[9, inf\]"),
        ({"uniform": [0, 1], "minimum": 1}, r"uniform.*\[1, inf\]"),
    ],
)
def test_what_is_no_distribution_is_refused_by_key(value, words):
    with pytest.raises(ScenarioError, match=rf"^people\.a\.speed: .*{words}"):
        parse(value, "people.a.speed")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0, "got 0"),
        ({"uniform": [-1, 1]}, "got -1"),
        ({"normal": [5, 1]}, "normal .*minimum"),
        ({"list": [1, -2]}, "got -2"),
    ],
)
def test_a_quantity_that_must_be_positive(value, words):
    with pytest.raises(ScenarioError, match=f"^key: .* 0, .*{words}$"):
        parse(value, "key", above=0.0)


@pytest.mark.parametrize("value", [{"lognormal": [0, 1]}, {"weibull": [1, 1]}, {"normal": [5, 1], "minimum": 0.1}])
def test_distributions_of_positive_numbers_are_positive(value):
    assert parse(value, "key", above=0.0).is_positive()


def test_lognormal_by_mean_and_deviation():
    found = parse({"lognormal": {"mean": 60.0, "deviation": 20.0}}, "key")
    assert found.mean() == pytest.approx(60.0)
    values = found.draw(generator_for(1, "lognormal"), 100_000)
    assert values.mean() == pytest.approx(60.0, rel=0.01)
    assert values.std() == pytest.approx(20.0, rel=0.02)


def test_generators_depend_on_seed_and_names_only():
    first = generator_for(1, "people", "a", "mass").random(3)
    assert np.array_equal(first, generator_for(1, "people", "a", "mass").random(3))
    for other in (generator_for(2, "people", "a", "mass"), generator_for(1, "people", "am", "ass")):
        assert not np.array_equal(first, other.random(3))


def test_a_generator_is_the_same_on_every_machine():
    assert generator_for(1, "people", "a", "mass").integers(0, 2**32) == 2152558792


def test_values_of_a_case_are_told_in_words():
    told = {
        "uniform from 0.2 to 0.25": {"uniform": [0.2, 0.25]},
        "normal: 1, 2; minimum: 0.5": {"normal": [1, 2], "minimum": 0.5},
        **{"factor: 0.5": {"factor": 0.5}, "-": {}, "1, 2": [1, 2], "none": [], "yes": True},
    }
    assert [as_text(value) for value in told.values()] == [*told]


def test_a_generator_goes_on_from_its_state_with_the_half_word_that_is_left():
    one, other = generator_for(1, "a"), generator_for(2, "b")
    one.integers(2**32, dtype=np.uint32)
    restore_generator(other, generator_state(one))
    assert (
        other.integers(2**32, size=5, dtype=np.uint32).tolist() == one.integers(2**32, size=5, dtype=np.uint32).tolist()
    )
