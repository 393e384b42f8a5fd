"""Mesh files of other programs: cells that are no part of a surface are told of and left out."""

import meshio

from evac.contract.registry import Registry, built_in


def test_cells_that_are_no_surface_are_noted(tmp_path):
    points = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [0, 0, 3]]
    cells = [("quad", [[0, 1, 2, 3]]), ("tetra", [[0, 1, 3, 4]]), ("vertex", [[0]])]
    meshio.Mesh(points, cells).write(tmp_path / "a.vtu")
    found = Registry(builtins=built_in("importer")).importer_for(tmp_path / "a.vtu")().read(tmp_path / "a.vtu")
    assert [list(cell) for cell in found.cells] == [[0, 1, 2, 3]]
    assert found.points.tolist() == points
    assert [*found.findings] == ["1 cells of type 'tetra' are not surface cells and are ignored"]
