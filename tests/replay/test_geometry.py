"""The building of a page: its shapes are those of the building, in centimetres from an origin."""

import numpy as np
import shapely

import evac
from evac.replay.geometry import building_for_page


def test_lines_of_the_page_are_those_of_the_building():
    plan = evac.Plan()
    plan.storey("low", [shapely.box(0, 0, 6, 6), shapely.box(6.2, 0, 9, 6)])
    plan.storey("high", shapely.box(0, 12, 9, 20), z=3.0)
    plan.door("inner", "low", [(6.1, 2), (6.1, 3.2)])
    plan.stair("up", "low", [(7, 6), (8.2, 6)], "high", [(7, 12), (8.2, 12)])
    plan.exit("out", "low", [(0, 1), (0, 2)])
    plan.exit("roof", "high", [(0, 15), (0, 16.5)])
    building, origin = plan.building(), np.array([-1.0, 2.0])
    page, _ = building_for_page(building, origin)
    for kind, lines in (("exits", building.exits), ("doors", building.doors)):
        assert len(page[kind]) == len(lines)
        for own, line in zip(page[kind], lines, strict=True):
            ends = np.reshape(line.segments if kind == "exits" else line.segment, (-1, 2))
            z = plan.storeys[building.levels[line.level].name].z
            told = np.reshape(own["segments"], (-1, 3)) / 100.0 + [*origin, 0.0]
            np.testing.assert_allclose(told, np.column_stack([ends, np.full(len(ends), z)]), atol=0.0051)
            assert own["level"] == line.level
    corners = np.reshape(page["vertices"], (-1, 3)) / 100.0 + [*origin, 0.0]
    np.testing.assert_allclose(corners, building.vertices, atol=0.0051)
