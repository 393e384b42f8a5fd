"""IFC files: units, rooms, uses, furniture, doors, exits, lifts and options."""

import math
import re

import pytest

import evac
from tests.ifcfiles import IfcFile, building_of, here, house, plan_of

__all__ = ["here"]

pytestmark = pytest.mark.usefixtures("unpictured", "here")

pytest.importorskip("ifclite_geom", reason="the extra evac[ifc] is not installed")


def test_true_north(tmp_path):
    ifc = house(IfcFile())
    assert plan_of(ifc.write(tmp_path / "a.ifc")).north is None
    north = ifc.add("IFCDIRECTION((0.5,0.8660254))")
    context = f"IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,{ifc.axes},"
    (tmp_path / "b.ifc").write_text(ifc.text().replace(f"{context}$)", f"{context}{north})"))
    assert building_of(tmp_path / "b.ifc").north == pytest.approx(-30.0)


@pytest.mark.parametrize(("spaces", "unit"), [(True, "METRE"), (False, "MILLI")])
def test_rooms_doors_and_exits(tmp_path, spaces, unit):
    building = building_of(house(IfcFile(unit=unit), spaces=spaces).write(tmp_path / "a.ifc"))
    (floor,) = building.levels
    assert floor.name == "L0"
    # Two rooms, the door's strip in the wall, and half of the wall's thickness to the exit.
    assert floor.polygon.area == pytest.approx(2 * 4.9 * 6.0 + 0.2 * 1.0 + 0.1 * 1.2, rel=1e-3)
    (way,) = building.exits
    assert (way.name, round(way.width, 2)) == ("front", 1.2)
    assert sorted(area.name for area in building.areas) == (["001", "002"] if spaces else [])


def test_a_turned_building_is_the_same(tmp_path):
    turned = (math.cos(0.3), math.sin(0.3))
    building = building_of(house(IfcFile(turned=turned)).write(tmp_path / "a.ifc"))
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(59.12, rel=1e-3)
    assert len(building.levels) == len(building.exits) == 1
    assert not [one for one in building.findings if one.kind == "warning"]


def test_options(tmp_path):
    ifc = house(IfcFile())
    ifc.box("IFCFURNITURE", "desk", (1, 1, 0), (2, 2, 0.7), tail=",$,.DESK.")
    ifc.box("IFCCOLUMN", "column", (8, 3, 0), (8.3, 3.3, 3.0))
    path = ifc.write(tmp_path / "a.ifc")
    free, full = (building_of(path, furniture=value).levels[0].polygon.area for value in (False, True))
    assert free == pytest.approx(59.12 - 0.09, rel=1e-3)
    assert free - full == pytest.approx(1.0, rel=1e-2)
    plan = plan_of(path, exits="none")
    assert (len(plan.exits), len(plan.openings)) == (0, 1)


def test_furniture_stands_on_its_storey_and_lamps_hang_above_it(tmp_path):
    ifc = house(IfcFile(), storeys=2)
    for z in (0, 3):
        ifc.box("IFCFURNITURE", "desk", (1, 1, z), (2, 2, z + 0.7), tail=",$,.DESK.")
        ifc.box("IFCFURNITURE", "lamp", (6, 3, z + 1.8), (7, 4, z + 2.2), tail=",$,.NOTDEFINED.")
    path = ifc.write(tmp_path / "a.ifc")
    free, full = (
        sum(level.polygon.area for level in building_of(path, furniture=value).levels) for value in (False, True)
    )
    assert free - full == pytest.approx(2.0, rel=1e-2)


def test_a_proxy_with_the_shape_of_a_slab_is_named_and_read_if_that_is_wanted(tmp_path):
    path = house(IfcFile(), spaces=False).write(tmp_path / "a.ifc")
    path.write_text(re.sub(r"IFCSLAB(.*)FLOOR", r"IFCBUILDINGELEMENTPROXY\1NOTDEFINED", path.read_text()))
    with pytest.raises(evac.BuildingError, match=r"no floor.*'S', a proxy.* 66\.6 m2"):
        plan_of(path)
    assert building_of(path, proxies=True).levels[0].polygon.area == pytest.approx(59.12, rel=1e-3)


@pytest.mark.parametrize("leaf", [((0.15, 3.1, 0), (0.19, 4.1, 2.1)), ((-0.05, 3.1, 0), (-0.01, 4.1, 2.1))])
def test_a_thin_leaf_belongs_to_its_opening(tmp_path, leaf):
    ifc = IfcFile()
    ifc.storey("L0", 0)
    ifc.box("IFCSLAB", "S", (0, 0, -0.2), (10.4, 6.4, 0), predefined="FLOOR")
    wall = ifc.box("IFCWALL", "W", (0, 0.2, 0), (0.2, 6.2, 3))
    ifc.opening((0, 3, 0), (0.2, 4.2, 2.1), wall=wall, door="front", leaf=leaf)
    ifc.space("room", [(0.2, 0.2), (10.2, 0.2), (10.2, 6.2), (0.2, 6.2)], 0)
    (way,) = building_of(ifc.write(tmp_path / "a.ifc")).exits
    assert (way.name, round(way.width, 2)) == ("front", 1.2)


def test_the_use_of_a_space_is_the_words_of_its_name(tmp_path):
    ifc = IfcFile()
    ifc.storey("L0", 0.0)
    for k, name in enumerate(("Treppenhaus 1", "Office Miller", "Office 12", "Seminar room", "001")):
        ifc.space(name, [(9 * k, 0), (9 * k + 8, 0), (9 * k + 8, 6), (9 * k, 6)], 0.0)
    rooms = {room.name: room.use for room in plan_of(ifc.write(tmp_path / "a.ifc")).rooms}
    offices = {"Office Miller": "office", "Office 12": "office"}
    assert rooms == {"Treppenhaus 1": "stair", **offices, "Seminar room": "seminar room", "001": "room"}


def test_a_void_in_a_slab_is_no_ground(tmp_path):
    path = house(IfcFile(), storeys=2, hole=(6, 2, 8, 4)).write(tmp_path / "a.ifc")
    upper = [level for level in building_of(path).levels if level.z_min == 3.0]
    assert sum(level.polygon.area for level in upper) == pytest.approx(59.0 - 4.0, rel=1e-3)
    (void,) = [one for one in plan_of(path).findings if one.kind == "left out"]
    assert (void.level, 6 < void.place[0] < 8) == ("L1", True)


def lift_file(ifc, tail, depth=2.0):
    """Write a house of two storeys with a transport element and its doors; return the element."""
    for z in (0.0, 3.0):
        ifc.opening((10.2, 2.5, z), (10.4, 3.5, z + 2.1), door="landing door")
    return ifc.box("IFCTRANSPORTELEMENT", "A", (10.7, 3.0 - depth / 2, 0.0), (12.3, 3.0 + depth / 2, 2.3), tail=tail)


@pytest.mark.parametrize(
    ("schema", "tail"), [("IFC4", ",.ELEVATOR."), ("IFC2X3", ",.ELEVATOR.,630.,8."), ("IFC4", ",.ESCALATOR.")]
)
def test_a_lift_is_read_with_the_stops_that_doors_lead_to_and_does_not_run_until_the_case_says_so(
    tmp_path, schema, tail
):
    ifc = house(IfcFile(schema=schema), storeys=2)
    lift_file(ifc, tail)
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    if "ESC" in tail:
        assert not building.lifts
        return
    (lift,) = building.lifts
    assert (lift.name, lift.storeys, lift.heights) == ("A", ("L0", "L1"), (0.0, 3.0))
    assert not lift.operation.service
    assert (lift.operation.capacity, lift.operation.load) == ((8, 630.0) if schema == "IFC2X3" else (13, None))
    assert building.levels[lift.rooms[0]].polygon.area == pytest.approx(1.6 * 2.0)
    assert [round(sum(building.portals[door].width for door in doors), 2) for doors in lift.doors] == [1.0, 1.0]
    assert not building.for_ways.is_open(building.portals[lift.doors[1][0]])


def test_a_car_without_a_stated_capacity_carries_as_many_as_its_ground_holds(tmp_path):
    ifc = house(IfcFile(), storeys=2)
    lift_file(ifc, ",.ELEVATOR.", depth=0.9)
    (lift,) = building_of(ifc.write(tmp_path / "a.ifc")).lifts
    assert lift.operation.capacity == 12  # 1.6 x 0.9 m


@pytest.mark.parametrize(
    ("people", "mass", "of_type", "unit", "found"),
    [
        ("IFCCOUNTMEASURE(8)", "630.", False, ".KILO.", (8, 630.0)),
        ("IFCINTEGER(8)", "630000.", True, "$", (8, 630.0)),
        ("IFCCOUNTMEASURE(0)", "0.", False, ".KILO.", (13, None)),
        ("IFCLABEL('many')", "1000.", False, ".KILO.", (13, 1000.0)),
        ("IFCCOUNTMEASURE(40)", "3000.", False, ".KILO.", (26, 3000.0)),  # on 3.2 m2
    ],
)
def test_a_lift_carries_what_its_properties_or_those_of_its_type_state_as_far_as_there_is_ground(
    tmp_path, people, mass, of_type, unit, found
):
    ifc = house(IfcFile(), storeys=2)
    ifc.add(f"IFCSIUNIT(*,.MASSUNIT.,{unit},.GRAM.)")
    element = lift_file(ifc, ",.ELEVATOR.")
    own = [
        ifc.add(f"IFCPROPERTYSINGLEVALUE('CapacityPeople',$,{people},$)"),
        ifc.add(f"IFCPROPERTYSINGLEVALUE('CapacityWeight',$,IFCMASSMEASURE({mass}),$)"),
    ]
    stated = ifc.add(f"IFCPROPERTYSET({ifc.guid()},$,'Pset_TransportElementCommon',$,({','.join(own)}))")
    if of_type:
        kind = ifc.add(f"IFCTRANSPORTELEMENTTYPE({ifc.guid()},$,'t',$,$,({stated}),$,$,$,.ELEVATOR.)")
        ifc.add(f"IFCRELDEFINESBYTYPE({ifc.guid()},$,$,$,({element}),{kind})")
    else:
        ifc.add(f"IFCRELDEFINESBYPROPERTIES({ifc.guid()},$,$,$,({element}),{stated})")
    (lift,) = building_of(ifc.write(tmp_path / "a.ifc")).lifts
    assert (lift.operation.capacity, lift.operation.load) == found
