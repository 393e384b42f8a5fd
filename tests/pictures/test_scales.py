"""Colour scales, which pictures, maps, the replay and reports have in common."""

import numpy as np
import pytest

from evac.analysis.maps import QUANTITIES
from evac.base.errors import ResultError
from evac.pictures import palette
from evac.pictures.palette import MAPS, PEOPLE, SERVICES, high_value, round_up


def test_every_quantity_has_a_scale_with_colours_of_the_palette():
    assert set(MAPS) == set(QUANTITIES)
    for scale in (*MAPS.values(), *PEOPLE.values()):
        assert scale.ramp().shape == (256, 3)
        np.testing.assert_array_equal(scale.ramp(), palette.ramp_of(scale.colours))
        places, texts = zip(*scale.ticks(scale.end(7.0)), strict=True)
        assert places[0] == 0.0
        assert list(places) == sorted(places)
        assert places[-1] <= 1.0 + 1e-9
        assert len(set(texts)) == len(texts) > 1


def test_forces_are_on_a_logarithmic_scale():
    force = PEOPLE["contact_force"]
    np.testing.assert_allclose(force.share(np.array([0.0, 10.0, 100.0, 1000.0, 1e5]), 1e4), [0, 0, 1 / 3, 2 / 3, 1])
    assert [text for _, text in force.ticks(1e4)] == ["10", "100", "1000", "10000"]
    none, least = force.colours_of(np.array([9.99, 10.0]), 1e4).tolist()
    assert (none, least) == (list(palette.rgb([palette.NOTHING])[0]), [13, 8, 135])
    assert "10 N" in force.below
    assert PEOPLE["speed"].below == ""


def test_levels_of_service_are_bands_of_density():
    density = MAPS["density"].with_service("fruin")
    colours, edges = density.ramp(), (0.31, 0.43, 0.72, 1.08, 2.15)
    assert SERVICES["fruin"].edges == edges
    values = np.linspace(0.0, 5.0, 256)
    for value, colour in zip(values, colours, strict=True):
        first = np.flatnonzero(np.digitize(values, edges) == np.digitize(value, edges))[0]
        np.testing.assert_array_equal(colour, colours[first])
    assert len(np.unique(colours, axis=0)) == 6
    assert [text.split()[0] for _, text in density.ticks(5.0)] == list("ABCDEF")
    assert len(np.unique(PEOPLE["density"].with_service("weidmann").ramp(), axis=0)) == 9
    assert MAPS["speed"].with_service("fruin") is MAPS["speed"]
    with pytest.raises(ResultError, match="'fruin'"):
        MAPS["density"].with_service("fruit")


def test_scales_end_at_round_numbers_that_most_values_stay_below():
    assert [round_up(value) for value in (0.0, 0.013, 1.0, 4.2, 61.0)] == [1.0, 0.015, 1.0, 5.0, 80.0]
    grid = np.array([[np.nan, np.inf, 0.0], [1.0, 2.0, 3.0]])
    assert high_value([grid]) == 2.0  # of 1, 2 and 3, the last one below which 99 % are
    assert high_value([np.zeros((2, 2))]) == 0.0
    ticks = {top: [float(text) for _, text in PEOPLE["speed"].ticks(top)] for top in (0.7, 6.0, 7.0)}
    assert ticks == {0.7: pytest.approx([0.0, 0.2, 0.4, 0.6]), 6.0: [0, 1, 2, 3, 4, 5, 6], 7.0: [0, 2, 4, 6]}
