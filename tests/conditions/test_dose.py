"""Doses of gases and heat: numbers of FDS, ISO 20414 test 19, the SFPE Handbook and ISO 13571."""

import math

import numpy as np
import pytest

from evac.conditions.dose import LETHAL, gas_rate, heat_rate, irritant_concentration
from evac.conditions.exposure import Exposure
from evac.people.population import Group
from evac.physics.state import make_crowd
from evac.simulation.shared import simulation_of
from tests.conditions.corridor import standing


def rate(form="fds", **air):
    return float(gas_rate(form, "light", {name: np.array([float(value)]) for name, value in air.items()})[0])


#: Irritants of FDS's verification case FED_FIC: each gives 0.0005994 of its lethal dose per minute. Its deck has them
#: with two decimals, 1.14 ppm NO2 for 1.13886 ppm, with which doses have three digits only.
IRRITATING = {name: 0.0005994 * lethal for name, lethal in LETHAL.items()}

#: Mixtures of FED_FIC, with dose and irritant concentration after 100 s as in FED_FIC.csv.
FED_FIC = [
    ({"o2": 9.772709, "co2": 3.430594, "co": 3241.86}, 0.59940, 0.0),
    ({"o2": 9.021848, "co2": 1.918864, "co": 2455.82, "no": 134.87, "hcn": 265.33}, 0.97403, 0.0),
    ({"o2": 20.9, **IRRITATING}, 0.0082584, 0.8574),
    (
        {"o2": 10.305454, "co2": 0.746276, "co": 1660.45, "no": 89.34, "hcn": 203.96}
        | {name: 0.5 * value for name, value in IRRITATING.items()},
        0.51369,
        0.4287,
    ),
]


@pytest.mark.parametrize(("air", "dose", "concentration"), FED_FIC)
def test_doses_and_irritants_are_those_of_fds(air, dose, concentration):
    assert rate(**air) * 100.0 / 60.0 == pytest.approx(dose, rel=1e-5)
    values = {name: np.array([value]) for name, value in air.items()}
    assert irritant_concentration(values)[0] == pytest.approx(concentration, abs=5e-5)


@pytest.mark.parametrize(("form", "time"), [("fds", 343.0), ("sfpe", 336.0), ("iso", 373.0)])
def test_the_forms_differ(form, time):
    assert 60.0 / rate(form, co=1000, hcn=100, co2=4, o2=17) == pytest.approx(time, abs=0.5)


def test_the_forms_differ_by_more_than_a_factor_of_two_with_much_cyanide_or_little_oxygen():
    for air in ({"co": 500, "hcn": 200, "co2": 3, "o2": 18}, {"co": 1000, "co2": 1, "o2": 12}):
        assert rate("fds", **air) > 2.0 * rate("iso", **air)


def test_activity_sets_the_breathing_rate():
    air = {"co": np.array([1000.0])}
    rest, light, heavy = (gas_rate("fds", activity, air)[0] for activity in ("rest", "light", "heavy"))
    assert (rest / light, heavy / light) == pytest.approx((8.5 / 25.0 * 30.0 / 40.0, 3.0))


@pytest.mark.parametrize(
    ("form", "minutes"),
    [("clothed", (156.0, 24.7, 5.7, 2.0)), ("unclothed", (45.0, 7.9, 2.0, 0.75)), ("design", (98.0, 12.3, 2.7, 0.91))],
)
def test_times_in_hot_air(form, minutes):
    found = 1.0 / heat_rate(form, {"temperature": np.array([60.0, 100.0, 150.0, 200.0])})
    np.testing.assert_allclose(found, minutes, rtol=0.02)


def test_radiation_adds_to_the_dose_of_heat_from_a_flux_on():
    cold = {"temperature": np.zeros(3), "radiation": np.array([2.4, 2.5, 10.0])}
    found = heat_rate("clothed", cold)
    assert found[0] == pytest.approx(0.0, abs=1e-8)
    np.testing.assert_allclose(1.0 / found[1:], 1.33 / np.array([2.5, 10.0]) ** 1.33)


def volume_of(mass):
    """Return the volume of oxygen in % in a mixture with nitrogen that has a fraction of its mass of oxygen."""
    oxygen, nitrogen = mass / 31.9988, (1.0 - mass) / 28.0134
    return 100.0 * oxygen / (oxygen + nitrogen)


#: The 1666.5 s at "12 %" are those of decks of FDS, which take masses: 0.134774 of oxygen, rounded, are 12.000246 %.
AT_12 = volume_of(0.134774)


@pytest.mark.parametrize(
    ("co2", "co", "o2", "time"),
    [
        (2.0, 1000.0, 15.0, 981.7),
        (0.0, 0.0, AT_12, 1666.5),
        (0.0, 0.0, 12.0, 60.0 * math.exp(8.13 - 0.54 * 8.9)),  # 1666.27 s
        (0.0, 1000.0, 21.0, 1692.8),
        (3.43, 1000.0, 21.0, 846.5),
        (2.0, 5000.0, 18.0, 208.7),  # NIST 2.6
    ],
)
def test_people_who_stand_in_gases_are_stopped_when_iso_19_says(co2, co, o2, time):
    exposure, fields = exposed(1, co2=co2, co=co, o2=o2)
    for now in np.arange(0.0, time + 10.0, 10.0):
        exposure.act(now, fields)
    assert exposure.stopped_at[0] == pytest.approx(60.0 / rate(co2=co2, co=co, o2=o2), abs=1e-6)
    assert exposure.stopped_at[0] == pytest.approx(time, abs=0.1)


def exposed(people, dose=None, seed=1, groups=None, **air):
    """Return the exposure of people who stand in gases, without a loop in which nobody moves."""
    case = standing(dose, **air).change({"simulation.seed": seed})
    simulation = simulation_of(case, will_run=False)
    crowd = make_crowd(np.full((people, 2), 1.0))
    groups = {"p": np.arange(people)} if groups is None else groups
    own = [Group(name, np.array(rows, np.int32), {}) for name, rows in groups.items()]
    return Exposure(case, simulation.scene, crowd, own), simulation.fields


def test_the_share_of_people_who_are_stopped_is_that_of_the_distribution():
    """CO 1999.86 ppm and CO2 0.049992 % give the dose 1 at 785.4 s, and by 999 s stop 60.1 % of 10,000 people."""
    air = {"co": 1999.86, "co2": 0.049992, "o2": 20.9}
    assert 60.0 / rate(**air) == pytest.approx(785.49, abs=0.1)
    exposure, fields = exposed(10_000, {"susceptibility": "log-normal"}, **air)
    for time in np.arange(0.0, 1000.0, 9.0):
        exposure.act(time, fields)
    assert exposure.stopped.mean() == pytest.approx(0.601, abs=0.02)
    logarithms = np.log(exposure.threshold)
    assert abs(logarithms.mean()) < 4.0 * 0.94 / math.sqrt(10_000)
    assert logarithms.std() == pytest.approx(0.94, rel=0.03)


def thresholds(seed=1, **groups):
    """Return the thresholds of the people of groups, by their rows."""
    air, own = {"co": 1.0, "co2": 0.04, "o2": 20.9}, {"susceptibility": "log-normal"}
    return exposed(sum(map(len, groups.values())), own, seed, groups, **air)[0].threshold


def test_each_person_has_a_threshold_of_its_own_whoever_else_is_there():
    alone = thresholds(p=range(5))
    assert len(set(alone)) == 5
    np.testing.assert_array_equal(thresholds(p=range(5)), alone)
    np.testing.assert_array_equal(thresholds(p=range(8))[:5], alone)
    np.testing.assert_array_equal(thresholds(q=range(3), p=range(3, 8))[3:], alone)
    np.testing.assert_array_equal(thresholds(p=[4, 2, 0, 3, 1])[[4, 2, 0, 3, 1]], alone)
    assert (thresholds(seed=2, p=range(5)) != alone).all()
    assert (thresholds(q=range(5)) != alone).all()
    assert (exposed(5, {"threshold": 0.3}, co=1.0, co2=0.04, o2=20.9)[0].threshold == 0.3).all()
