"""Marches in worker processes: the same bits for any number, whatever happens to a worker."""

import multiprocessing.process
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evac.directions import build
from evac.directions.build import build_fields
from evac.directions.march import workers
from evac.directions.march.workers import WORKER_BYTES, March, march_all, number_of_workers
from evac.directions.raster.grids import build_grids
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
    monkeypatch.setattr(workers, "NODES_PER_WORKER", 1)
    monkeypatch.setattr(workers, "cores", lambda: 8)
    return started


def _assert_same(fields, expected):
    for name in ("direction", "travel_time", "field_of", "offset"):
        np.testing.assert_array_equal(getattr(fields.packed, name), getattr(expected.packed, name))


def _assert_ended(started):
    assert all(process.exitcode is not None for process in started)


@pytest.mark.parametrize("number", [2, 3])
@pytest.mark.parametrize("clearance", [0.0, 0.25])
def test_fields_are_the_same_to_the_bit_for_any_number_of_workers(building, many, number, clearance):
    expected = build_fields(building, ROUTES, clearance=clearance, workers=1)
    assert many == []
    fields = build_fields(building, ROUTES, clearance=clearance, workers=number)
    assert 1 <= len(many) <= number
    _assert_same(fields, expected)
    _assert_ended(many)


def test_fields_are_the_same_where_gaps_are_avoided_and_links_are_closed(building, many):
    building = replace(building, closed=frozenset({building.link_of(building.exits[0])}))
    routes = (Route(), Route(("B",), "shortest"))
    alone, shared = (build_fields(building, routes, narrowest=2.0, workers=number) for number in (1, None))
    assert 1 <= len(many) <= 8
    _assert_same(shared, alone)


def test_marches_of_workers_that_die_are_made_here(building, many, monkeypatch):
    expected = build_fields(building, ROUTES)
    monkeypatch.setattr(workers, "_march", os._exit)
    _assert_same(build_fields(building, ROUTES, workers=3), expected)
    assert many
    _assert_ended(many)


def test_a_march_that_fails_in_a_worker_is_made_here(building, many, monkeypatch):
    """As for lack of memory: a worker that has no grids raises an error."""
    expected = build_fields(building, ROUTES)
    monkeypatch.setattr(workers, "_take", print)
    _assert_same(build_fields(building, ROUTES, workers=2), expected)
    assert 1 <= len(many) <= 2
    _assert_ended(many)


def test_without_processes_everything_is_marched_here(building, many, monkeypatch):
    def refuse(process):
        raise OSError("no more processes")

    expected = build_fields(building, ROUTES)
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)
    _assert_same(build_fields(building, ROUTES, workers=3), expected)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interruption_ends_the_workers(building, many, monkeypatch, error):
    def stop(*_):
        raise error

    monkeypatch.setattr(build, "_directions", stop)
    with pytest.raises(error):
        build_fields(building, ROUTES, workers=2)
    assert 1 <= len(many) <= 2
    _assert_ended(many)


def test_marches_that_nobody_waits_for_are_given_up(building, many):
    grids = build_grids(building, 0.1, 0.25)
    metric = workers.Metric(np.ones((3, 3)), np.broadcast_to(1.0, grids.size))
    costs = march_all(grids, [March(metric, list(building.exits))] * 50, 2, 2)
    next(costs)
    costs.close()
    _assert_ended(many)


def test_small_buildings_have_no_workers(building, monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda: 8)
    monkeypatch.setattr("evac.base.processes.Pool", None)
    build_fields(building, ROUTES, workers=None)
    build_fields(building, ROUTES, workers=8)


def test_the_number_of_workers(building, monkeypatch):
    """At most as many as wanted, cores, marches, and as the nodes and the memory allow."""
    grids = build_grids(building, 0.1, 0.25)
    monkeypatch.setattr(workers, "cores", lambda: 8)
    monkeypatch.setattr(workers, "NODES_PER_WORKER", grids.size)
    much = 100.0 * WORKER_BYTES
    assert number_of_workers(grids, 6, much, 4) == 4
    assert number_of_workers(grids, 6, much, None) == 6
    assert number_of_workers(grids, 20, much, None) == 8
    assert number_of_workers(grids, 20, much, 12) == 8
    assert number_of_workers(grids, 6, 3.5 * WORKER_BYTES, None) == 3
    assert number_of_workers(grids, 6, 0.5 * WORKER_BYTES, None) == 1
    assert number_of_workers(grids, 6, -1.0, None) == 1
    monkeypatch.setattr(workers, "NODES_PER_WORKER", 3 * grids.size)
    assert number_of_workers(grids, 6, much, None) == 2


@pytest.mark.parametrize("nodes", [10**5, 10**6, 4 * 10**6, 10**7, 2 * 10**7])
def test_one_large_level_has_no_workers(monkeypatch, nodes):
    """Each would march the whole level at the same time: several times the memory."""
    monkeypatch.setattr(workers, "cores", lambda: 8)
    grids = SimpleNamespace(size=nodes, levels=[SimpleNamespace(sheet=SimpleNamespace(size=nodes))])
    assert number_of_workers(grids, 2, build._memory_of_workers(nodes, 1), None) == 1
