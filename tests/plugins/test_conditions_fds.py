"""Slices of FDS in buildings of several storeys: which plane applies where, and what the slices cover."""

import numpy as np
import pytest

import evac
from evac.base.toml import toml_value
from evac.simulation.checkpoints import differences_of, made_of
from evac.simulation.shared import simulation_of
from evac_buildings.office_fire.write_slices import CO, EXTINCTION, write_slices

BOX = [(0, 12, 0, 8, 0, 6.0)]


def house(path, people=(("up", 1.0, 4.0),), heights=(1.7,), **changes):
    """Return a case of two storeys of 12 m by 8 m with a stair between them, and people at places."""
    room = [[0, 0], [12, 0], [12, 8], [0, 8]]
    plan = {
        "storeys": [
            {"name": "down", "z": 0.0, "polygons": [room]},
            {"name": "up", "z": 3.0, "polygons": [room]},
        ],
        "stairs": [
            {
                "name": "stair",
                "lower": "down",
                "lower_edge": [[4, 1.2], [4, 2.7]],
                "upper": "up",
                "length": 5.0,
                "direction": [1, 0],
            }
        ],
        "exits": [{"name": "out", "storey": "down", "segment": [[0, 3], [0, 5]]}],
    }
    groups = [
        {"name": f"p{k}", "level": level, "positions": [[x, y]], "height": height, "radius": 0.2, "speed": 1.2}
        for k, ((level, x, y), height) in enumerate(zip(people, heights, strict=True))
    ]
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": groups,
        "conditions": [{"source": "fds", "file": str(path), "hold": True}],
        "smoke": {"routes": False},
        "directions": {"spacing": 0.25},
    }
    return evac.load(table, changes)


def constant(value):
    return lambda x, y, z, time: value + 0.0 * x


@pytest.fixture
def two_planes(tmp_path):
    """Slices at 1.5 and 4.5 m with K of 1 and 2."""
    planes = [(EXTINCTION, 1.5, False, constant(1.0)), (EXTINCTION, 4.5, False, constant(2.0))]
    return write_slices(tmp_path, BOX, planes, [0.0, 10.0])[0]


def at(simulation, level, x, y, head, quantity="extinction", time=0.0):
    air, building = simulation.exposure.air, simulation.building
    index = np.array([building.level_named(level).index], np.int32)
    return air.at((quantity,), time, index, np.array([[x, y]]), np.array([head]))[0, 0]


def test_each_storey_has_its_plane_and_stairs_are_between_them(two_planes):
    simulation = simulation_of(house(two_planes))
    assert at(simulation, "down", 2.0, 2.0, 1.6) == at(simulation, "down", 2.0, 2.0, 1.4) == 1.0
    assert at(simulation, "up", 2.0, 2.0, 4.6) == at(simulation, "up", 2.0, 2.0, 4.4) == 2.0
    flight = next(level for level in simulation.building.levels if level.kind == "flight")
    for z in (1.5, 2.25, 3.0, 4.5):
        assert at(simulation, flight.name, 6.0, 2.0, z) == pytest.approx(1.0 + (z - 1.5) / 3.0)


def test_people_go_down_through_smoke_that_slows_them_on_the_stair_too(two_planes):
    results = simulation_of(house(two_planes)).run()
    clear = simulation_of(house(two_planes, smoke={"law": "none", "routes": False})).run()
    assert results.ended == "everybody out"
    assert results.exposure["greatest_extinction"][0] == 2.0
    assert 1.05 < results.crowd.exit_time[0] / clear.crowd.exit_time[0] < 1.0 / (1.0 - 2.0 * 0.057 / 0.706)


def test_volumes_are_read_at_the_head_of_each_person(tmp_path):
    """K rises with height in a layer: a child is below it."""
    layer = [(EXTINCTION, None, False, lambda x, y, z, t: np.clip(4.0 * (np.mod(z, 3.0) - 1.0), 0.0, 4.0))]
    path, _ = write_slices(tmp_path, BOX, layer, [0.0, 10.0], 0.25)
    simulation = simulation_of(house(path, (("up", 2.0, 4.0), ("up", 2.0, 6.0)), (1.0, 1.8)))
    simulation.advance_tick()
    np.testing.assert_allclose(simulation.exposure.extinction, [0.0, 4.0 * (0.9 * 1.8 - 1.0)], atol=1e-6)


def test_a_gradient_of_smoke_is_read_at_the_place_of_each_person_in_all_meshes(tmp_path):
    meshes = [(0, 5, 0, 8, 0, 6.0), (5, 12, 0, 4, 0, 6.0), (5, 12, 4, 8, 0, 6.0)]
    planes = [(EXTINCTION, z, centred, lambda x, y, z, t: 0.2 * x + 0.1 * y + 0.05 * t)
              for z, centred in ((1.5, False), (4.5, True))]  # fmt: skip
    path, _ = write_slices(tmp_path, meshes, planes, [0.0, 4.0, 10.0])
    simulation = simulation_of(house(path))
    for x, y in np.random.default_rng(4).uniform(0.4, 7.6, (20, 2)):
        for time in (0.0, 2.0, 7.0):
            assert at(simulation, "down", x, y, 1.5, time=time) == pytest.approx(
                0.2 * x + 0.1 * y + 0.05 * time, abs=1e-5
            )
            if abs(x - 5.0) > 0.25 and abs(y - 4.0) > 0.25:  # within half a cell of a mesh, values at centres hold
                found = at(simulation, "up", x, y, 4.5, time=time)
                assert found == pytest.approx(0.2 * x + 0.1 * y + 0.05 * time, abs=1e-5)


def test_volumes_are_read_in_all_meshes(tmp_path):
    meshes = [(0, 5, 0, 8, 0, 6.0), (5, 12, 0, 4, 0, 6.0), (5, 12, 4, 8, 0, 6.0)]
    volumes = [(EXTINCTION, None, False, lambda x, y, z, t: 0.2 * x + 0.1 * y + 0.5 * z)]
    simulation = simulation_of(house(write_slices(tmp_path, meshes, volumes, [0.0, 10.0])[0]))
    for x, y in ((1.0, 1.0), (4.5, 7.0), (6.0, 1.0), (11.0, 3.5), (6.0, 5.0), (11.0, 7.0)):
        for level, z in (("down", 1.5), ("up", 4.6)):
            assert at(simulation, level, x, y, z) == pytest.approx(0.2 * x + 0.1 * y + 0.5 * z, abs=1e-5)


def test_units_are_those_of_the_quantities(tmp_path):
    planes = [(CO, z, False, constant(5e-4)) for z in (1.5, 4.5)]
    planes += [("OXYGEN VOLUME FRACTION", z, False, constant(0.19)) for z in (1.5, 4.5)]
    planes += [("INTEGRATED INTENSITY", z, False, constant(8.0)) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path, BOX, planes, [0.0, 10.0])
    simulation = simulation_of(house(path, smoke={"law": "none", "routes": False}))
    for quantity, value in (("co", 500.0), ("o2", 19.0), ("radiation", 2.0)):
        assert at(simulation, "down", 2.0, 2.0, 1.5, quantity) == pytest.approx(value, rel=1e-6)


def test_a_plane_too_far_from_heads_is_refused_with_the_line_that_the_deck_needs(tmp_path):
    planes = [(EXTINCTION, 1.5, False, constant(1.0)), (EXTINCTION, 5.0, False, constant(2.0))]
    path, _ = write_slices(tmp_path, BOX, planes, [0.0, 10.0])
    with pytest.raises(evac.ScenarioError) as error:
        simulation_of(house(path))
    deck = "&SLCF PBZ=4.53, QUANTITY='EXTINCTION COEFFICIENT' /"
    for word in ("level 'up'", "z = 4.53 m", "5.00 m", deck, "level", "within = 0.5"):
        assert word in str(error.value)
    children = (("down", 1.0, 4.0),), (1.0,)
    with pytest.raises(evac.ScenarioError, match=r"PBZ=0\.90"):
        simulation_of(house(path, *children))
    only = {"source": "fds", "file": str(path), "hold": True, "level": ["down", "stair"]}
    simulation = simulation_of(house(path, (("down", 1.0, 4.0),), conditions=[only]))
    assert at(simulation, "up", 2.0, 2.0, 4.5) == 0.0


def test_planes_farther_from_heads_are_read_where_the_case_says_so_and_told(tmp_path):
    planes = [(EXTINCTION, z, False, constant(k)) for k, z in ((1.0, 1.5), (2.0, 5.0))]
    planes += [("TEMPERATURE", z, False, constant(30.0)) for z in (1.5, 5.0)]
    path, _ = write_slices(tmp_path, BOX, planes, [0.0, 10.0])
    source = {"source": "fds", "file": str(path), "hold": True, "within": 0.5}
    simulation = simulation_of(house(path, conditions=[source]))
    assert at(simulation, "up", 2.0, 2.0, 4.53) == 2.0
    (line,) = simulation.exposure.air.sources[0].findings()
    assert "level 'up': extinction, temperature are those 0.47 m above the heads of group 'p0'" in line


@pytest.mark.parametrize("name", ["SOOT VISIBILITY", "VISIBILITY"])
def test_visibility_is_read_where_there_is_no_extinction_coefficient(tmp_path, name):
    planes = [(name, z, False, lambda x, y, z, t: 30.0 - 2.5 * t + 0.0 * x) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path, BOX, planes, [0.0, 10.0])
    lines = [" m" if line == " mol/mol" else line for line in path.read_text().splitlines()]
    path.write_text("\n".join([*lines, ""]))
    simulation = simulation_of(house(path))
    for time, value in ((0.0, 0.0), (4.0, 3.0 / 20.0), (10.0, 3.0 / 5.0)):
        assert at(simulation, "down", 2.0, 2.0, 1.5, time=time) == pytest.approx(value)
    both = [*planes, *((EXTINCTION, z, False, constant(1.0)) for z in (1.5, 4.5))]
    path, _ = write_slices(tmp_path / "both", BOX, both, [0.0, 10.0])
    assert at(simulation_of(house(path)), "down", 2.0, 2.0, 1.5) == 1.0


def test_what_slices_do_not_cover_is_told_with_the_shift_that_would_fit(tmp_path):
    half = [(6, 12, 0, 8, 0, 6.0)]
    planes = [(EXTINCTION, z, False, constant(1.0)) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path, half, planes, [0.0, 10.0])
    findings = simulation_of(house(path)).results().summary()["conditions"]["findings"]
    assert any("% of level 'down'" in line and "exits outside: out" in line for line in findings)
    assert any("shift = [-3.00, 0.00, 0]" in line for line in findings)
    simulation = simulation_of(house(path))
    assert at(simulation, "down", 2.0, 2.0, 1.5) == 0.0
    moved = {"source": "fds", "file": str(path), "hold": True, "shift": [-6.0, 0.0, 0.0]}
    assert at(simulation_of(house(path, conditions=[moved])), "down", 2.0, 2.0, 1.5) == 1.0
    far = {**moved, "shift": [100.0, 0.0, 0.0]}
    with pytest.raises(evac.ScenarioError, match=r"cover nothing .* shift = \[-3\.00"):
        simulation_of(house(path, conditions=[far]))


def test_vertical_planes_are_refused_with_the_line_that_the_deck_needs(tmp_path):
    upright = (EXTINCTION, (6, 6, 0, 8, 0, 6), False, constant(1.0))
    path, _ = write_slices(tmp_path / "only", BOX, [upright], [0.0, 10.0])
    line = "&SLCF PBZ=1.53, QUANTITY='EXTINCTION COEFFICIENT' /"
    with pytest.raises(evac.ScenarioError) as error:
        simulation_of(house(path))
    assert all(word in str(error.value) for word in ("fire.smv", "PBX", line))
    slices = [(CO, z, False, constant(0.0)) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path / "some", BOX, [*slices, upright], [0.0, 10.0])
    with pytest.raises(evac.ScenarioError) as error:
        simulation_of(house(path))
    assert all(word in str(error.value) for word in ("no source provides extinction", "PBX", line))
    assert "\n" not in str(error.value)


def test_a_quantity_that_fewer_slices_have_is_named(tmp_path):
    slices = [(EXTINCTION, z, False, constant(1.0)) for z in (1.5, 4.5)]
    slices += [(CO, (0, 6, 0, 8, z, z), False, constant(0.0)) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path, BOX, slices, [0.0, 10.0])
    findings = simulation_of(house(path)).results().summary()["conditions"]["findings"]
    assert findings[0].endswith("slices of co cover 49 % of level 'down'")
    assert not any("shift" in line for line in findings)


def test_slices_that_end_before_the_run_are_an_error_unless_they_hold(tmp_path):
    path, _ = write_slices(tmp_path, BOX, [(EXTINCTION, z, False, constant(1.0)) for z in (1.5, 4.5)], [0.0, 2.0])
    ending = house(path, conditions=[{"source": "fds", "file": str(path)}])
    with pytest.raises(evac.ScenarioError, match=r"conditions\.0: the values end at 2 s .* hold = true"):
        simulation_of(ending).run()


def test_a_complete_set_of_slices_has_no_findings(two_planes):
    assert simulation_of(house(two_planes)).results().summary()["conditions"]["findings"] == []


def test_the_lines_of_the_deck_are_those_that_make_the_case_run(tmp_path, two_planes):
    simulation = simulation_of(house(two_planes, heights=(1.7,)))
    source, scene = simulation.exposure.air.sources[0], simulation.exposure.air.scenes[0]
    lines = source.deck(scene)
    assert "&SLCF PBZ=1.53, QUANTITY='EXTINCTION COEFFICIENT' /" in lines
    assert "&SLCF PBZ=4.53, QUANTITY='VOLUME FRACTION', SPEC_ID='OXYGEN' /" in lines
    assert any(line.startswith("&SLCF XB=") for line in lines)
    assert lines[-1].startswith("&DUMP DT_SLCF=1.")
    assert source.deck(scene) == lines


def test_a_run_with_slices_is_resumed_with_the_same_bits(tmp_path):
    planes = [(EXTINCTION, z, False, lambda x, y, z, t: 0.2 * x + 0.1 * t) for z in (1.5, 4.5)]
    path, _ = write_slices(tmp_path, BOX, planes, [0.0, 4.0, 10.0])
    simulation, other = simulation_of(house(path)), simulation_of(house(path))
    for _ in range(50):
        simulation.advance_tick()
    other.restore(simulation.state())
    np.testing.assert_array_equal(simulation.run().crowd.exit_time, other.run().crowd.exit_time)


def test_a_run_whose_slices_have_changed_is_not_resumed(two_planes):
    before = made_of(simulation_of(house(two_planes)))
    assert differences_of(before, made_of(simulation_of(house(two_planes)))) == []
    slices = two_planes.with_name("fire_02_1.sf")
    slices.write_bytes(slices.read_bytes()[:-5] + b"\0" + slices.read_bytes()[-4:])
    (line,) = differences_of(before, made_of(simulation_of(house(two_planes))))
    assert "fire_02_1.sf" in line


def toml(case):
    """Return a case as TOML, with its tables in lines."""
    return "\n".join(f"{key} = {toml_value(value)}" for key, value in case.table.items())


@pytest.mark.parametrize(
    ("name", "value", "unit", "words"),
    [
        ("TEMPERATURE", 293.15, "C", "kelvin"),
        ("TEMPERATURE", 20.0, "K", "in 'K'"),
        (EXTINCTION, 1e30, "1/m", "gives 1e.30 1/m"),
        (EXTINCTION, -1.0, "1/m", "gives -1 1/m"),
        (CO, -1.0, "mol/mol", "gives -1e.06 ppm"),
        (CO, 1e-3, "kg/kg", "in 'kg/kg'"),
    ],
)
def test_values_and_units_that_a_quantity_cannot_have_are_refused_and_not_clipped(tmp_path, name, value, unit, words):
    path, _ = write_slices(tmp_path, BOX, [(name, z, False, constant(value)) for z in (1.5, 4.5)], [0.0, 10.0])
    lines = path.read_text().splitlines()
    path.write_text(
        "\n".join([*(f" {unit}" if lines[k - 2].strip() == name else line for k, line in enumerate(lines)), ""])
    )
    with pytest.raises(evac.ScenarioError, match=words):
        simulation_of(house(path))
