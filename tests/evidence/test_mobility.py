"""Speeds of presets for reduced mobility, and wheelchairs at doors, as the page on mobility measures them."""

import pytest

from evac.evidence.mobility import page


def test_electric_wheelchairs_have_their_speeds_on_the_flat_and_on_ramps():
    flat, up, down = (page.walking_speeds("electric_wheelchair", way, 1) for way in ("flat", "up", "down"))
    assert ((flat > 0.84) & (flat < 0.94)).all()
    assert up == pytest.approx(flat, rel=0.02)
    assert down == pytest.approx(flat, rel=0.02)


def test_wheelchairs_pass_an_accessible_door_and_not_a_narrower_one():
    wide, narrow = (page.flow_through(width, 0.1, 1) for width in (page.DOORS[0], 0.7))
    assert wide["left"] == 0
    assert narrow["left"] >= 3, "the wheelchairs, and those behind them"
    assert wide["flow [1/s]"] > 0.1
    assert narrow["flow [1/s]"] is None
