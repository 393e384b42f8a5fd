"""Slice files of FDS: read as they are written and as fdsreader reads them, and refused if they are damaged."""

import random

import numpy as np
import pytest

import evac
from evac.conditions.slices import HEADER, read_slices
from evac_buildings.office_fire.write_slices import CO, EXTINCTION, write_slices

MESHES = [(0, 4, 0, 3, 0, 3), (4, 8, 0, 3, 0, 3)]


def wave(x, y, z, time):
    return 1.0 + np.sin(x) * np.cos(y) + 0.1 * z + 0.01 * time


#: Kinds of slices: height (None: a volume), and whether values are at the centres of cells.
KINDS = [(1.5, False), (1.5, True), (None, False), (None, True)]


@pytest.mark.parametrize(("z", "is_centred"), KINDS)
@pytest.mark.parametrize("cell", [0.25, 0.5, 1.0])
def test_values_and_places_are_those_written(tmp_path, z, is_centred, cell):
    path, _ = write_slices(tmp_path, MESHES, [(EXTINCTION, z, is_centred, wave)], [0.0, 1.0, 2.5], cell)
    blocks = read_slices(path, frozenset([EXTINCTION]))
    assert len(blocks) == 2
    for block in blocks:
        np.testing.assert_array_equal(block.times, [0.0, 1.0, 2.5])
        x, y, height = np.meshgrid(*block.axes, indexing="ij")
        for index, time in enumerate(block.times):
            np.testing.assert_allclose(block.frame(index), wave(x, y, height, time).T, atol=1e-6)
        if is_centred:
            assert (block.axes[0][0] - block.ends[0, 0]) == pytest.approx(0.5 * cell)


def test_values_are_linear_in_space_and_time(tmp_path):
    path, _ = write_slices(tmp_path, MESHES, [(CO, None, False, lambda x, y, z, t: x + 2 * y - z + t)], [0.0, 2.0])
    block = read_slices(path, frozenset([CO]))[0]
    points = np.random.default_rng(1).uniform(0.1, 2.9, (3, 50))
    nodes, weights = block.weigh(points)
    x, y, z = points
    for time in (0.0, 0.7, 2.0):
        np.testing.assert_allclose(block.at(time, nodes, weights), x + 2 * y - z + time, atol=1e-5)


def test_a_last_time_that_is_not_complete_is_left_out(tmp_path):
    path, written = write_slices(tmp_path, MESHES, [(CO, 1.5, False, wave)], [0.0, 1.0, 2.0])
    for name in written:
        file = tmp_path / name
        file.write_bytes(file.read_bytes()[:-20])
    assert [block.times.tolist() for block in read_slices(path, frozenset([CO]))] == [[0.0, 1.0]] * 2


def test_other_quantities_are_left_out_and_empty_files_and_gaps_in_time_refused(tmp_path):
    path, written = write_slices(tmp_path, MESHES[:1], [(CO, 1.5, False, wave), (EXTINCTION, 1.5, False, wave)], [0.0])
    assert [block.quantity for block in read_slices(path, frozenset([CO]))] == [CO]
    file = tmp_path / next(iter(written))
    for content in (b"", file.read_bytes()[:-20]):
        file.write_bytes(content)
        with pytest.raises(evac.ScenarioError, match=f"{file.name}: "):
            read_slices(path, frozenset([CO, EXTINCTION]))
    for times in ([*range(10), 21.0], [0.0, 1.0, 2.0, 21.0], [0.0, 20.0, 21.0, 22.0]):
        path, _ = write_slices(tmp_path / f"gap {len(times)}", MESHES[:1], [(CO, 1.5, False, wave)], times)
        with pytest.raises(evac.ScenarioError, match=r"between \d+ and \d+ s"):
            read_slices(path, frozenset([CO]))


@pytest.mark.parametrize("is_centred", [False, True])
def test_vertical_planes_are_known(tmp_path, is_centred):
    boxes = [(2, 2, 0, 3, 0, 3), (0, 4, 1, 1, 0, 3), (0, 4, 0, 3, 0, 3)]
    path, _ = write_slices(tmp_path, MESHES[:1], [(CO, box, is_centred, wave) for box in boxes], [0.0])
    assert [block.is_vertical for block in read_slices(path, frozenset([CO]))] == [True, True, False]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("fire_01_1.sf", "../fire_01_1.sf"), ["outside of its folder"]),
        (lambda text: text.replace("SLCF     1", "SLCF     7"), ["line", "no mesh 7"]),
        (lambda text: text.replace("&    0     8", "&    0    99"), ["line", "outside of mesh 1"]),
        (lambda text: text.replace("&    0     8", f"&    0 {10**30}"), ["line", "six indices"]),
        (lambda text: text.replace("TRNY", "TRNX"), ["TRNX"]),
        (lambda text: text.replace("  1  0.500000", "  1  9.500000"), ["TRNX", "increase"]),
        (lambda text: text.replace("  8 6 6 0", "  8 x 6 0"), ["GRID"]),
        (lambda text: text.split(" short")[0], ["fewer than four lines"]),
        (lambda text: text.replace("fire_01_1.sf", "missing.sf"), ["missing.sf", "cannot be read"]),
    ],
)
def test_damaged_smokeview_files_are_refused_with_the_line(tmp_path, change, words):
    path, _ = write_slices(tmp_path, MESHES, [(CO, 1.5, False, wave)], [0.0, 1.0])
    path.write_text(change(path.read_text()))
    with pytest.raises(evac.ScenarioError) as error:
        read_slices(path, frozenset([CO]))
    assert all(word in str(error.value) for word in words), error.value


def test_times_that_do_not_increase_are_refused_with_their_number(tmp_path):
    path, written = write_slices(tmp_path, MESHES[:1], [(CO, 1.5, False, wave)], [0.0, 1.0, 0.5, 2.0])
    with pytest.raises(evac.ScenarioError, match=rf"{next(iter(written))}: time 3, 0\.5 s"):
        read_slices(path, frozenset([CO]))


def test_values_that_are_not_finite_are_refused_with_file_and_time(tmp_path):
    path, written = write_slices(
        tmp_path, MESHES[:1], [(CO, 1.5, False, lambda x, y, z, t: np.where(t > 1, np.nan, x))], [0.0, 2.0]
    )
    block = read_slices(path, frozenset([CO]))[0]
    block.frame(0)
    with pytest.raises(evac.ScenarioError, match=rf"{next(iter(written))}: t = 2 s"):
        block.frame(1)


def test_damaged_files_are_read_right_or_refused(tmp_path):
    """300 files with bytes changed, removed or inserted: an error of evac, or frames of numbers."""
    path, written = write_slices(tmp_path, MESHES[:1], [(CO, 1.5, False, wave)], [0.0, 1.0, 2.0], 1.0)
    file = tmp_path / next(iter(written))
    intact = {path: path.read_bytes(), file: file.read_bytes()}
    values = written[file.name]
    source, refused = random.Random(7), []
    for trial in range(300):
        for each, content in intact.items():
            each.write_bytes(content)
        damaged = path if trial % 2 else file
        data = bytearray(intact[damaged])
        for _ in range(source.choice((1, 1, 4))):
            at = source.randrange(len(data))
            match source.randrange(4):
                case 0:
                    data[at] = source.randrange(256)
                case 1:
                    del data[at : at + source.choice((1, 4, 40))]
                case 2:
                    data[at:at] = bytes(source.randrange(256) for _ in range(source.choice((1, 4))))
                case _:
                    del data[at:]
            if not data:
                break
        damaged.write_bytes(bytes(data))
        try:
            for block in read_slices(path, frozenset([CO])):
                for index in range(len(block.times)):
                    assert np.isfinite(block.frame(index)).all()
                assert len(block.times) <= len(values)
        except evac.ScenarioError as error:
            refused.append(str(error))
    assert 50 < len(refused) < 300
    assert all(str(tmp_path) in line and "\n" not in line for line in refused)


def test_only_two_times_are_kept_in_memory(tmp_path):
    path, _ = write_slices(tmp_path, MESHES[:1], [(CO, None, False, wave)], np.arange(20.0))
    block = read_slices(path, frozenset([CO]))[0]
    for index in range(20):
        block.frame(index)
    assert len(block._frames) == 2
    assert HEADER.itemsize == 3 * 38 + 32


@pytest.mark.parametrize(("z", "is_centred"), KINDS)
def test_arrays_are_those_of_fdsreader(tmp_path, z, is_centred):
    fdsreader = pytest.importorskip("fdsreader")
    for trial in range(10):
        generator = np.random.default_rng(trial)
        folder = tmp_path / str(trial)
        times = np.arange(3.0) * generator.uniform(0.5, 2.0)
        offsets = generator.uniform(-1.0, 1.0, 3)
        function = lambda x, y, z, t, o=offsets: o[0] * x + o[1] * y + o[2] * z + t  # noqa: E731
        path, _ = write_slices(folder, MESHES[: 1 + trial % 2], [(EXTINCTION, z, is_centred, function)], times)
        (folder / "fire.fds").write_text("&HEAD CHID='fire' /\n")
        blocks = read_slices(path, frozenset([EXTINCTION]))
        slices = fdsreader.Simulation(str(folder)).slices
        theirs = [part for one in slices for part in one.subslices]
        assert len(theirs) == len(blocks)
        for block, part in zip(blocks, theirs, strict=True):
            own = np.array([block.frame(index).T for index in range(len(block.times))])
            np.testing.assert_array_equal(own.reshape(part.data.shape), part.data)
            for letter, axis in zip("xyz", block.axes, strict=True):
                np.testing.assert_allclose(axis, part.get_coordinates()[letter], atol=1e-5)
