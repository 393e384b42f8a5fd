"""Shapes of IFC products: what never ends or ends its process is named, and the rest is read."""

import time

import numpy as np
import pytest

from evac.building.recover.products import read_products

LIBRARY = """
import os

def entity_data(content, **_):
    if content == b"damaged":
        raise ValueError("unexpected token")
    one = {"name": None, "object_type": None, "placement": None, "attributes": []}
    kinds = {number: "IfcWall" if number < 90 else "IfcDoor" for number in range(100)}
    return {"entities": {n: one | {"ifc_type": kind, "has_geometry": n != 5} for n, kind in kinds.items()}}

def geometry_data_buffers(content, ids):
    while 7 in ids:
        pass
    if 8 in ids:
        os._exit(1)
    points, faces = bytes(9 * 8), (0).to_bytes(4, "little") * 3
    return {"elements": {number: {"vertices": points, "faces": faces} for number in ids}}
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    (tmp_path / "ifclite_geom.py").write_text(LIBRARY, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)


def test_products_that_hang_or_crash_the_library_cost_themselves_alone(library):
    started = time.monotonic()
    read = read_products(b"file", {"IfcWall"}, each=1.0, total=60.0)
    assert time.monotonic() - started < 50.0
    assert set(read.shapes) == set(range(90)) - {5, 7, 8}
    assert set(read.late) == {7, 8}
    assert "1 s" in read.late[7]
    points, triangles = read.shapes[1]
    assert (points.shape, triangles.dtype) == ((3, 3), np.int64)


def test_products_for_which_no_time_is_left_are_named(library):
    read = read_products(b"file", {"IfcWall", "IfcDoor"}, each=2.0, total=1.0)
    assert set(read.late) == set(range(100)) - {5}


def test_a_file_that_the_library_refuses_is_damaged(library):
    with pytest.raises(ValueError, match="unexpected token"):
        read_products(b"damaged", {"IfcWall"}, each=1.0, total=60.0)
