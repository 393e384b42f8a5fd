"""Random and damaged meshes give a building with as much ground as shapely finds, or one message with a place."""

import re

import pytest

from evac.base.errors import EvacError
from evac.simulation.assembly import read_building
from tests.properties.random_meshes import KINDS, random_mesh
from tests.properties.seeded import drawn

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
        for line in refusal.splitlines():
            assert line.startswith(str(path))
            assert PLACE.search(line), f"seed {seed}, {mesh.kind}: no place in {line}"
        return False
    area = sum(level.polygon.area for level in building.levels)
    assert area == pytest.approx(mesh.area(), rel=AREA), f"seed {seed}, {mesh.kind}"
    return True


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=list(KINDS))
@drawn(5)
def test_a_random_mesh_has_its_ground_or_is_refused_with_a_place(tmp_path_factory, kind, seed):
    is_sound = list(KINDS)[kind] in ("plan", "triangulation", "fan", "without extent", "storeys", "far")
    assert is_built(seed % 1000 * len(KINDS) + kind, tmp_path_factory.mktemp("mesh")) or not is_sound
