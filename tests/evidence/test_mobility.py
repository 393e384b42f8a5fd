"""Speeds of presets for reduced mobility, and wheelchairs at doors, as the page on mobility measures them."""

import numpy as np
import pytest

from evac.evidence.evidence import Evidence
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


def test_the_page_judges_deviations_and_doors(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "PUBLISHED", {"crutches": 0.94})
    monkeypatch.setattr(page, "ON_RAMPS", ("electric_wheelchair",))
    monkeypatch.setattr(page, "DOORS", (1.2,))
    monkeypatch.setattr(page, "QUEUE", 10)
    page.run(Evidence("mobility", tmp_path, quick=True))
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "| crutches | flat | 24 |" in text
    assert "| electric_wheelchair | down | 24 |" in text
    assert "2 of 2" in text
    assert np.isclose(page.SFPE_FLOW * (1.2 - page.SFPE_EDGES), 1.17)
