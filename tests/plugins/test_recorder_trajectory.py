from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shapely.geometry import box

from evac.base.change import Change
from evac.base.saved import SavedError
from evac.building.model.building import Building, Exit, Level
from evac.results.results import versions
from evac.trajectory.recorder import Recording
from evac.trajectory.trajectory import TRAJECTORY_NAME, read_trajectory, trajectory_in_memory
from evac_plugins.recorder_trajectory import TrajectoryRecorder

CORNER = np.array([3.0e6, 5.0e6])


@pytest.fixture
def simulation(tmp_path):
    """Three people in a square room of 10 m; the last one belongs to no group."""
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]) + CORNER
    floor = Level(
        index=0,
        name="room",
        kind="floor",
        stair=None,
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        polygon=box(*square[0], *square[2]),
        uphill=np.zeros(2),
        slope=0.0,
        z_min=1.5,
        z_max=1.5,
    )
    building = Building(
        source=Path("room.msh"),
        vertices=np.column_stack([square, np.full(4, 1.5)]),
        levels=(floor,),
        portals=(),
        exits=(Exit(0, "door", 0, np.array([[*square[0], *square[1]]]), 10.0),),
        areas=(),
        walls=np.column_stack([square, np.roll(square, -1, axis=0)]),
        wall_level=np.zeros(4, np.int32),
        stairs={},
    )
    crowd = SimpleNamespace(
        level=np.zeros(3, np.int32),
        radius=np.array([0.2, 0.21, 0.22]),
        height=np.array([1.2, 1.6, 1.8]),
        position=np.array([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]]) + CORNER,
        contact_force=np.zeros(3),
        start_time=np.zeros(3),
    )
    groups = (SimpleNamespace(name="pair", rows=np.array([0, 1], np.int32)),)
    return SimpleNamespace(
        case=SimpleNamespace(
            title="A room", people=(), output=SimpleNamespace(trajectory=True), smoke=SimpleNamespace(contrast=3.0)
        ),
        scene=SimpleNamespace(shared_scene=SimpleNamespace(building=building), changes=[], fields_of_behaviours={}),
        population=SimpleNamespace(crowd=crowd, groups=groups),
        displacement_velocity=np.array([[0.5, 0.0], [0.0, 0.25], [0.0, 0.0]]),
        dose=None,
        standing=np.zeros(3, np.bool_),
        time=0.0,
        seed=11,
        folder=tmp_path / "result",
    )


def run(simulation, times):
    recorder = TrajectoryRecorder()
    recorder.start(simulation)
    for simulation.time in times:
        simulation.population.crowd.position[:, 1] = CORNER[1] + 1.0 + simulation.time
        recorder.record(simulation)
    return recorder


def test_file_tells_all_that_a_picture_needs(simulation):
    run(simulation, [0.0, 0.5]).finish(simulation, None)
    trajectory = read_trajectory(simulation.folder)
    assert trajectory.header["title"] == "A room"
    assert trajectory.header["seed"] == 11
    assert trajectory.header["versions"] == versions()
    assert trajectory.groups == ("pair",)
    assert trajectory.group.tolist() == [0, 0, -1]
    assert trajectory.radius.tolist() == [0.2, 0.21, 0.22]
    assert trajectory.height.tolist() == [1.2, 1.6, 1.8]
    assert trajectory.time.tolist() == [0.0, 0.5]
    np.testing.assert_array_equal(trajectory.building.vertices, simulation.scene.shared_scene.building.vertices)
    expected = np.array([[1.0, 1.5], [2.0, 1.5], [3.0, 1.5]]) + CORNER
    np.testing.assert_allclose(trajectory.position[1], expected, rtol=0.0, atol=1e-6)
    assert (trajectory.z == 1.5).all()
    np.testing.assert_array_equal(trajectory.velocity[1][:, :2], simulation.displacement_velocity)


def test_frames_can_be_read_while_the_run_goes_on(simulation):
    recorder = run(simulation, [0.0, 0.5, 1.0])
    assert len(read_trajectory(simulation.folder)) == 3
    recorder.finish(simulation, None)


def test_end_between_two_output_times_is_kept_once(simulation):
    recorder = run(simulation, [0.0, 0.5])
    simulation.time = 0.73
    simulation.population.crowd.level[:] = -1
    recorder.finish(simulation, None)
    trajectory = read_trajectory(simulation.folder)
    assert trajectory.time.tolist() == [0.0, 0.5, 0.73]
    assert (trajectory.level[-1] == -1).all()


def test_changes_are_kept_once_in_the_frame_after_them(simulation):
    recorder = run(simulation, [0.0])
    simulation.scene.changes.append(Change(0.25, "close", "door"))
    for simulation.time in (0.5, 1.0):
        recorder.record(simulation)
    simulation.scene.changes.append(Change(1.0, "open", "door"))
    simulation.time = 1.1
    recorder.finish(simulation, None)
    trajectory = read_trajectory(simulation.folder)
    assert [len(rows.changes) for rows in trajectory.rows] == [0, 1, 0, 1]
    assert list(trajectory.changes) == simulation.scene.changes


def test_memory_has_the_frames_and_the_header_of_the_file(simulation):
    simulation.population.crowd.level[1] = -1
    simulation.population.crowd.start_time[2] = 0.3
    simulation.scene.changes.append(Change(0.0, "close", "door"))
    run(simulation, [0.0, 0.5]).finish(simulation, None)
    written = read_trajectory(simulation.folder)
    simulation.folder, simulation.recording = None, Recording([], None, in_memory=True)
    assert simulation.recording.in_memory() is None
    recorder = run(simulation, [0.0, 0.5])
    kept = trajectory_in_memory(simulation.recording.in_memory())
    simulation.time = 1.0
    recorder.finish(simulation, None)
    assert len(trajectory_in_memory(simulation.recording.in_memory())) == 3
    assert kept.header == written.header
    assert len(kept) == len(written) == 2
    for ours, theirs in zip(kept.rows, written.rows, strict=True):
        assert (ours.time, ours.changes) == (theirs.time, theirs.changes)
        for name in ("person", "level", "started", "motion"):
            own, other = getattr(ours, name), getattr(theirs, name)
            assert (own.dtype, own.flags.writeable) == (other.dtype, other.flags.writeable)
            np.testing.assert_array_equal(own, other)


def test_a_state_is_that_of_a_run_with_or_without_a_file(simulation):
    recorder = run(simulation, [0.0, 0.5])
    state, files = recorder.state(), recorder.files()
    assert files == {TRAJECTORY_NAME: (simulation.folder / TRAJECTORY_NAME).stat().st_size}
    recorder.check_state(simulation, state, simulation.folder, files)
    with pytest.raises(SavedError, match=TRAJECTORY_NAME):
        recorder.check_state(simulation, state, simulation.folder, {})
    recorder.finish(simulation, None)
    simulation.case.output.trajectory = False
    recorder.check_state(simulation, {}, simulation.folder, {})
    with pytest.raises(SavedError, match=TRAJECTORY_NAME):
        recorder.check_state(simulation, {}, simulation.folder, files)
