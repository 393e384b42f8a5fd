"""Speeds in smoke: the laws, and people who walk through a corridor (NIST 2.5, ISO 20414 test 18)."""

from functools import cache

import numpy as np
import pytest

import evac
from evac.conditions.law import share_in_smoke, share_with_irritants
from evac.contract.registry import Registry
from evac.simulation.shared import simulation_of
from tests.conditions.corridor import corridor, prescribed, two_storeys

LAWS = Registry().smoke_laws


def walked(case):
    """Run to the end; return the exit time of the first person and the time from x = 20 to 80 m."""
    simulation = simulation_of(case)
    crowd, passed = simulation.population.crowd, []
    while not simulation.ended:
        before = crowd.position[0, 0]
        simulation.advance_tick()
        after = crowd.position[0, 0]
        passed += [simulation.time - 0.1 * (after - x) / (after - before) for x in (20.0, 80.0) if before < x <= after]
    return crowd.exit_time[0], passed[1] - passed[0]


@cache
def in_clear_air():
    return walked(corridor())


@pytest.mark.parametrize(
    ("extinction", "ratio"), [(0.5, 1.0421), (1.0, 1.0878), (3.0, 1.3196), (7.5, 2.5350), (10.0, 5.1912)]
)
def test_times_in_a_corridor_are_those_of_iso_18(extinction, ratio):
    """The band of ISO 18 follows from the start and from the tick: (2 tau (1 - f) + 2 dt) / t0."""
    (clear, clear_part), (time, part) = in_clear_air(), walked(corridor(prescribed(extinction)))
    f = 1.0 / ratio
    assert abs(time / clear * f - 1.0) <= (2.0 * 0.2 * (1.0 - f) + 2.0 * 0.1) / clear
    assert part / clear_part == pytest.approx(ratio, rel=1e-3)


def test_nobody_is_slowed_in_clear_air_nor_by_the_law_none():
    clear = in_clear_air()
    assert walked(corridor(prescribed(0.0))) == clear
    assert walked(corridor(prescribed(10.0), smoke={"law": "none", "routes": False})) == clear


def test_speeds_of_the_default_law_are_those_of_the_guide_of_fds_evac():
    soot = np.array([0.0, 500.0, 1000.0, 1500.0])  # mg/m3
    speed = LAWS["fds_evac"]().speed(np.full(4, 1.5), 8700.0 * soot * 1e-6)
    np.testing.assert_allclose(speed, [1.5, 0.973, 0.446, 0.15], atol=6e-4)


@pytest.mark.parametrize(
    ("name", "given", "desired", "extinction", "speed"),
    [
        ("fridolf", {}, 1.2, 1.0, 0.86),  # visibility 2 m
        ("fridolf", {}, 1.2, 0.6, 1.2),
        ("fridolf", {}, 1.2, 100.0, 0.2),
        ("fridolf", {"contrast": 8.0}, 1.2, 4.0, 0.86),
        ("jin", {}, 1.25, 1.0, 0.6247),
        ("jin", {}, 1.25, 0.25, 0.5 * (1.25 + 0.841)),
        ("jin", {}, 1.25, 5.0, 0.3),
        ("jin", {}, 0.5, 1.0, 0.5),
        ("jin_irritant", {}, 1.25, 0.4, 0.76858),
        ("sfpe", {}, 1.25, 1.0, 0.6423),
        ("sfpe", {}, 1.25, 4.0, 0.4532),
        ("none", {}, 1.25, 9.0, 1.25),
    ],
)
def test_speeds_of_the_laws(name, given, desired, extinction, speed):
    found = LAWS[name](**given).speed(np.array([desired]), np.array([extinction]))
    assert found[0] == pytest.approx(speed, abs=5e-5)


def test_losses_by_smoke_and_irritants_add():
    fic = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0])
    np.testing.assert_allclose(share_with_irritants(fic), [1.0, 0.914, 0.714, 0.308, 0.141, 0.083, 0.0], atol=6e-4)
    np.testing.assert_array_equal(share_with_irritants(np.array([2.0, 50.0])), 0.0)
    smoke, desired = np.full(7, 3.0), np.full(7, 1.25)
    share = share_in_smoke(LAWS["fds_evac"](), desired, smoke, fic)
    np.testing.assert_allclose(share, np.maximum(1.0 - 3.0 * 0.057 / 0.706 - (1.0 - share_with_irritants(fic)), 0.1))
    only = share_in_smoke(LAWS["jin_irritant"](), desired, smoke, fic)
    np.testing.assert_array_equal(only, only[0])


@pytest.mark.parametrize(
    ("name", "least"), [("fds_evac", 0.12), ("fridolf", 0.2), ("jin", 0.3), ("sfpe", 0.1), ("none", 0.12)]
)
def test_irritants_halt_nobody_because_laws_keep_their_least_speed(name, least):
    for smoke in (0.0, 6.0):
        share = share_in_smoke(LAWS[name](), np.array([1.2]), np.array([smoke]), np.array([2.2]))
        assert 1.2 * share[0] == pytest.approx(least)


def test_irritants_slow_people_who_recover_behind_them():
    times = [walked(corridor(prescribed(values={"extinction": 0.0, **gas})))[1] for gas in ({}, {"acrolein": 4.0})]
    assert times[0] / times[1] == pytest.approx(share_with_irritants(np.array([0.2]))[0], rel=1e-3)
    off = {"irritants": False, "routes": False}
    assert walked(corridor(prescribed(values={"extinction": 0.0, "acrolein": 4.0}), smoke=off))[1] == times[0]


def test_the_law_is_applied_to_speeds_on_stairs():
    """The time down a flight in smoke, over that in clear air, is the inverse of the share of the speed."""
    plan = two_storeys()

    def down(*conditions):
        changes = {"building.plan": plan, "people.p.level": "up", "people.p.positions": [[11.0, 2.0]]}
        simulation = simulation_of(corridor(*conditions).change(changes))
        crowd, passed = simulation.population.crowd, []
        while not simulation.ended:
            before = crowd.position[0, 0]
            simulation.advance_tick()
            after = crowd.position[0, 0]
            passed += [
                simulation.time - 0.1 * (x - after) / (before - after) for x in (8.5, 4.5) if after <= x < before
            ]
        return passed[1] - passed[0]

    assert down(prescribed(3.0, level="stair")) / down() == pytest.approx(1.3196, rel=2e-3)


TEN_LINES = """
from evac import SmokeLaw
class Half(SmokeLaw):
    '''Half the speed in any smoke.'''
    name = "half"
    def speed(self, desired, extinction):
        return desired * (1.0 - 0.5 * (extinction > 0.0))
evac_interface = 3
"""


def test_a_law_is_a_plugin_of_ten_lines(tmp_path):
    path = tmp_path / "half.py"
    path.write_text(TEN_LINES)
    case = corridor(prescribed(1.0))
    changed = evac.load(case.to_dict(), {"smoke.law": "half"}, plugin_files=[path])
    assert walked(changed)[1] == pytest.approx(2.0 * in_clear_air()[1], rel=1e-6)
