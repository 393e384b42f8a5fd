"""Marches in worker processes: the same bits for any number, whatever happens to a worker."""

import multiprocessing.process
import os
from dataclasses import replace

import numpy as np
import pytest

from evac.base.progress import shown_by
from evac.directions import build
from evac.directions.build import build_fields
from evac.directions.march import marching
from evac.directions.routes import Route

ROUTES = (Route(), Route(("A",)), Route(("B",), "comfortable"))


@pytest.fixture
def building(drawing):
    """Two storeys linked by a stair, with an exit on each."""
    drawing.level((0, 0, 6, 5), z=3.0)
    drawing.level((6, 2, 10, 3.5), uphill=(-1, 0), slope=0.64)
    drawing.level((10, 0, 16, 5))
    drawing.portal(0, 1, (6, 2), (6, 3.5))
    drawing.portal(1, 2, (10, 2), (10, 3.5))
    drawing.exit("A", 2, (16, 2), (16, 3.5))
    drawing.exit("B", 0, (0, 2), (0, 3.5))
    return drawing.build()


@pytest.fixture
def many(started, monkeypatch):
    """Let workers pay on small grids, on a machine with many cores; return those that are started."""
    monkeypatch.setattr(marching, "NODES_PER_WORKER", 1)
    monkeypatch.setattr(marching, "cores", lambda: 8)
    return started


def _assert_same(fields, expected):
    for name in ("direction", "travel_time", "field_of", "offset"):
        np.testing.assert_array_equal(getattr(fields.packed, name), getattr(expected.packed, name))


def _assert_ended(started):
    assert all(process.exitcode is not None for process in started)


def test_the_levels_that_each_march_has_reached_are_told(building, monkeypatch):
    told = []
    monkeypatch.setattr("evac.base.progress.shown_by", [*shown_by, lambda *steps: told.append(steps)])
    build_fields(building, ROUTES[:2], clearance=0.0, workers=1)
    grids = [steps for steps in told if steps[0] == "laying grids"]
    assert grids == [("laying grids", k, 3) for k in range(4)]
    assert {(what, count) for what, _, count in told[len(grids) :]} == {("computing directions", 6)}  # 2 of 3 levels
    done = [steps[1] for steps in told[len(grids) :]]
    assert done == sorted(done)
    assert {*done} == {0, 3, 5, 6}  # from both exits, all levels are reached at once


def test_fields_are_the_same_to_the_bit_for_any_number_of_workers(building, many):
    building = replace(building, closed=frozenset({building.link_of(building.exits[0])}))
    routes = (Route(), Route(("B",), "shortest"))
    alone = build_fields(building, routes, narrowest=2.0, workers=1)
    assert many == []
    _assert_same(build_fields(building, routes, narrowest=2.0, workers=None), alone)
    assert 1 <= len(many) <= 8
    _assert_ended(many)


def test_marches_of_workers_that_die_are_made_here(building, many, monkeypatch):
    expected = build_fields(building, ROUTES)
    monkeypatch.setattr(marching, "_march", os._exit)
    _assert_same(build_fields(building, ROUTES, workers=3), expected)
    assert many
    _assert_ended(many)


def test_without_processes_everything_is_marched_here(building, many, monkeypatch):
    def refuse(process):
        raise OSError("no more processes")

    expected = build_fields(building, ROUTES)
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)
    _assert_same(build_fields(building, ROUTES, workers=3), expected)


def test_an_interruption_ends_the_workers(building, many, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(build, "_directions", stop)
    with pytest.raises(KeyboardInterrupt):
        build_fields(building, ROUTES, workers=2)
    assert 1 <= len(many) <= 2
    _assert_ended(many)
