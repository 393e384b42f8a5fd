"""The clock of a run: every moment belongs to one phase."""

import itertools
from types import SimpleNamespace

import pytest

from evac.base.progress import PHASES, Phases


@pytest.fixture
def counted(monkeypatch):
    """Return a clock for which one second passes whenever it is looked at."""
    monkeypatch.setattr("evac.base.progress.time", SimpleNamespace(perf_counter=itertools.count(0.0).__next__))
    return Phases()


def test_an_inner_phase_is_not_charged_to_the_outer_one(counted):
    with counted.enter("output"), counted.enter("physics"), counted.enter("recording"):
        pass
    assert counted.seconds() == dict.fromkeys(PHASES, 0.0) | {"output": 2.0, "physics": 2.0, "recording": 1.0}


def test_the_phase_that_is_not_left_yet_counts_up_to_now(counted):
    with counted.enter("output"):
        assert counted.seconds()["output"] == 1.0
        assert counted.seconds()["output"] == 2.0


def test_time_outside_of_all_phases_is_charged_to_none(counted):
    with counted.enter("people"):
        pass
    counted.seconds()
    with pytest.raises(ValueError, match="oops"), counted.enter("people"):
        raise ValueError("oops")
    assert counted.seconds() == dict.fromkeys(PHASES, 0.0) | {"people": 2.0}


def test_time_goes_to_the_phase_that_was_turned_to(counted):
    with counted.enter("output"), counted.enter("physics"):
        counted.turn_to("recording")
    assert counted.seconds() == dict.fromkeys(PHASES, 0.0) | {"output": 2.0, "physics": 1.0, "recording": 1.0}
