"""Columns of fields that are solved again: what is solved in part agrees with what is solved as a whole."""

import numpy as np
import pytest

from evac.directions.build import build_fields
from evac.directions.density import Gates
from evac.directions.march.waves import time_from
from evac.directions.routefield import RouteField
from evac.directions.routes import Route

LEVELS = {0, 1, 2}


@pytest.fixture
def make_column(row):
    fields = build_fields(row, [Route((), "quickest")], speeds=(1.0, 0.5, 0.5))
    time, direction = fields.packed.travel_time, fields.packed.direction
    return lambda: RouteField(fields, time.copy(), direction.copy(), 0, Gates(fields.grids[0].grids))


def density_on(column, row, levels):
    """Return densities that decrease along x, on some levels."""
    density = np.zeros(len(column.speed))
    at = np.isin(column.waves.level_of, list(levels))
    density[at] = np.linspace(4.0, 1.0, np.count_nonzero(at))
    return density


def test_levels_that_are_solved_alone_agree_with_all_solved_together(make_column, row):
    in_steps, at_once = make_column(), make_column()
    for crowded in ({1}, {1, 2}, {0, 2}):
        density = density_on(in_steps, row, crowded)
        changed = in_steps.slow_down(density, LEVELS, 0.05, noticed=0.0)
        assert changed
        in_steps.solve(changed, LEVELS, is_first=True)
    at_once.solve(at_once.slow_down(density, LEVELS, 0.05, noticed=0.0), LEVELS, is_first=True)
    known = np.isfinite(at_once.waves.time)
    assert known.any()
    assert in_steps.waves.time[known] == pytest.approx(at_once.waves.time[known], abs=1e-9)


def test_restored_columns_go_on_with_the_same_bits(make_column, row):
    one, other = make_column(), make_column()
    one.solve(one.slow_down(density_on(one, row, {1}), LEVELS, 0.05), {1}, is_first=True)
    assert one.march.stale == {0}
    other.restore(one.state())
    for column in (one, other):
        column.solve(column.slow_down(density_on(column, row, {2}), {2}, 0.05), LEVELS, is_first=False)
    for name, values in one.state().items():
        np.testing.assert_array_equal(values, other.state()[name], name)


def test_the_next_gate_of_each_room_and_the_time_to_it(make_column, row):
    waves, middle = make_column().waves, {}
    for grid_level in LEVELS:
        own = (waves.level_of == grid_level) & (waves.gate >= 0)
        middle[grid_level] = set(waves.gate[own & (waves.walk > 1.0)].tolist())
        assert waves.walk[own].max() == pytest.approx(np.hypot(8.0, 1.0), abs=0.5)  # at 1 m/s
    portals = [{portal.index} for portal in sorted(row.portals, key=lambda portal: min(portal.levels))]
    assert [middle[0], middle[1], middle[2]] == [*portals, {row.link_of(row.exits[0])}]


def test_another_exit_must_save_the_hesitation_and_a_twentieth_of_what_remains(make_column):
    waves = make_column().waves.replace(hesitation=2.0)
    waves.former[:2], waves.exit[1] = (0, 1), 1
    found = []
    for remaining in (10.0, 100.0):
        waves.time[1] = remaining
        found.append(time_from(waves, 0, 1))
    assert found == pytest.approx([12.0, 105.0])
