"""Random and damaged meshes give a building with as much ground as shapely finds, or one message with a place."""

import re

import pytest

from evac.base.errors import BuildingError, EvacError
from evac.simulation.assembly import read_building
from tests.building.random_meshes import KINDS, random_mesh

#: Share by which the ground of a building may differ from what is drawn.
AREA = 1e-3
PLACE = re.compile(r"at \(-?\d|around \(-?\d|edge \(-?\d|vertex \(-?\d|polygon at \(-?\d")


def is_built(seed, folder):
    """Check one mesh; say whether it was built, not refused."""
    mesh = random_mesh(seed)
    path = mesh.write(folder)
    refusal = ""
    try:
        building = read_building(path, need_exit=False)
    except EvacError as error:
        refusal = str(error)
    if refusal:
        assert PLACE.search(refusal), f"seed {seed}, {mesh.kind}: no place in {refusal}"
        assert "\n" not in refusal
        return False
    area = sum(level.polygon.area for level in building.levels)
    assert area == pytest.approx(mesh.area(), rel=AREA), f"seed {seed}, {mesh.kind}"
    return True


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=list(KINDS))
def test_a_few_of_each_kind(tmp_path, kind):
    built = [is_built(seed, tmp_path) for seed in range(kind, 5 * len(KINDS), len(KINDS))]
    assert all(built) or list(KINDS)[kind] not in ("plan", "triangulation", "fan", "without extent", "storeys", "far")


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 2000, 100))
def test_a_thousand(tmp_path, first):
    assert sum(is_built(seed, tmp_path) for seed in range(first, first + 100)) > 40


NEEDLES = {
    "counted twice where they overlap": [
        [[16.716975, 14.087936, -0.000184], [-0.000392, -8.1e-05, 9.1e-05], [16.716088, 14.08645, 0.000105]],
        [[0.000287, -9e-05, 6.6e-05], [16.71639, 14.087837, -0.000101], [-1.189236, -1.62489, -5.6e-05]],
        [[8.6e-05, -0.000329, 0.0], [16.711782, 14.094443, 5.7e-05], [16.716705, 14.088064, 1.5e-05]],
    ],
    "of which nothing is left after splitting": [
        [[12.028384, 10.698391, -0.000138], [12.212345, 10.083531, 0.000221], [6.8e-05, -0.001063, -3.1e-05]],
        [[12.024323, 10.693661, 0.000311], [12.02821, 10.700045, 0.000877], [0.000217, -0.00236, -0.001113]],
        [[-0.001198, 0.000693, 7.7e-05], [-0.00262, 0.012056, -2.6e-05], [12.030031, 10.700467, 0.00025]],
        [[12.028255, 10.699065, 9e-06], [3.3e-05, -5e-05, -5e-06], [0.612145, -0.327173, 1.6e-05]],
    ],
}


@pytest.mark.parametrize("name", NEEDLES)
def test_needles_are_refused_with_a_place(mesh, read, name):
    for corners in NEEDLES[name]:
        mesh.face(*(tuple(corner) for corner in corners))
    with pytest.raises(BuildingError, match=r" at \(| edge \("):
        read(mesh, need_exit=False)
