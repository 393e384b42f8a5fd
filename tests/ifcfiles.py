"""Small IFC files, written for tests and read: storeys, and bodies that are extruded or have faces of their own."""

import itertools
from concurrent.futures import Future

import pytest

import evac
from evac.base.processes import Pool
from evac.contract.registry import Registry, built_in

HEADER = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('{schema}'));
ENDSEC;
DATA;
"""


class IfcFile:
    """A building with storeys; lengths are in metres and written in the unit of the file."""

    def __init__(self, *, unit="METRE", schema="IFC4", turned=(1.0, 0.0)):
        self.lines = []
        self.schema = schema
        self.scale = {"METRE": 1.0, "MILLI": 1000.0}[unit]
        self._ids = itertools.count(1)
        origin = self.add("IFCCARTESIANPOINT((0.,0.,0.))")
        up, along = self.add("IFCDIRECTION((0.,0.,1.))"), self.add(f"IFCDIRECTION(({turned[0]},{turned[1]},0.))")
        self.up = up
        self.axes = self.add(f"IFCAXIS2PLACEMENT3D({origin},{up},{along})")
        self.context = self.add(f"IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,{self.axes},$)")
        prefix = "$" if unit == "METRE" else ".MILLI."
        length = self.add(f"IFCSIUNIT(*,.LENGTHUNIT.,{prefix},.METRE.)")
        units = self.add(f"IFCUNITASSIGNMENT(({length}))")
        self.project = self.add(f"IFCPROJECT({self.guid()},$,'p',$,$,$,$,({self.context}),{units})")
        self.placement = self.add(f"IFCLOCALPLACEMENT($,{self.axes})")
        self.building = self.add(f"IFCBUILDING({self.guid()},$,'b',$,$,{self.placement},$,$,.ELEMENT.,$,$,$)")
        self.add(f"IFCRELAGGREGATES({self.guid()},$,$,$,{self.project},({self.building}))")

    def add(self, text):
        number = next(self._ids)
        self.lines.append(f"#{number}={text};")
        return f"#{number}"

    def guid(self):
        return f"'{len(self.lines):022d}'"

    def number(self, value):
        return repr(round(float(value) * self.scale, 6))

    def point(self, *values):
        return self.add(f"IFCCARTESIANPOINT(({','.join(self.number(value) for value in values)}))")

    def storey(self, name, z):
        axes = self.add(f"IFCAXIS2PLACEMENT3D({self.point(0, 0, z)},$,$)")
        placement = self.add(f"IFCLOCALPLACEMENT({self.placement},{axes})")
        made = self.add(f"IFCBUILDINGSTOREY({self.guid()},$,'{name}',$,$,{placement},$,$,.ELEMENT.,{self.number(z)})")
        self.add(f"IFCRELAGGREGATES({self.guid()},$,$,$,{self.building},({made}))")
        return made

    def extruded(self, outline, z, height):
        points = ",".join(self.point(x, y) for x, y in [*outline, outline[0]])
        line = self.add(f"IFCPOLYLINE(({points}))")
        profile = self.add(f"IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,{line})")
        axes = self.add(f"IFCAXIS2PLACEMENT3D({self.point(0, 0, z)},$,$)")
        return self.add(f"IFCEXTRUDEDAREASOLID({profile},{axes},{self.up},{self.number(height)})")

    def lying(self, profile, y, width):
        """Return the solid of a profile [(x, z), ...] that is extruded from y towards smaller y."""
        points = ",".join(self.point(x, z) for x, z in [*profile, profile[0]])
        line = self.add(f"IFCPOLYLINE(({points}))")
        made = self.add(f"IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,{line})")
        back, along = self.add("IFCDIRECTION((0.,-1.,0.))"), self.add("IFCDIRECTION((1.,0.,0.))")
        axes = self.add(f"IFCAXIS2PLACEMENT3D({self.point(0, y, 0)},{back},{along})")
        return self.add(f"IFCEXTRUDEDAREASOLID({made},{axes},{self.up},{self.number(width)})")

    def body(self, kind, name, *solids, predefined=None, tail=""):
        """Add an element of a class with attributes up to its tag, then `tail`."""
        shape = self.add(f"IFCSHAPEREPRESENTATION({self.context},'Body','SweptSolid',({','.join(solids)}))")
        product = self.add(f"IFCPRODUCTDEFINITIONSHAPE($,$,({shape}))")
        tail = tail or f",.{predefined or 'NOTDEFINED'}."
        return self.add(f"{kind}({self.guid()},$,'{name}',$,$,{self.placement},{product},$" + tail + ")")

    def box(self, kind, name, low, high, **options):
        (x1, y1, z1), (x2, y2, z2) = low, high
        outline = [(x1, y1), (x2, y1), (x2, y2), (x1, y2)]
        return self.body(kind, name, self.extruded(outline, z1, z2 - z1), **options)

    def space(self, name, outline, z, height=2.6):
        return self.body("IFCSPACE", name, self.extruded(outline, z, height), tail=",$,.ELEMENT.,.INTERNAL.,$")

    def opening(self, low, high, *, wall=None, door=None, window=None, leaf=None):
        """Add an opening, cut it out of a wall or slab, and fill it; with a leaf, its box and a relation to it."""
        made = self.box("IFCOPENINGELEMENT", "Opening", low, high)
        if wall:
            self.add(f"IFCRELVOIDSELEMENT({self.guid()},$,$,$,{wall},{made})")
        if door:
            filling = self.box("IFCDOOR", door, *(leaf or (low, high)), tail=",$,$,.DOOR.,.NOTDEFINED.,$")
            if leaf:
                self.add(f"IFCRELFILLSELEMENT({self.guid()},$,$,$,{made},{filling})")
        if window:
            self.box("IFCWINDOW", window, low, high, tail=",$,$,.WINDOW.,.NOTDEFINED.,$")
        return made

    def text(self):
        return HEADER.format(schema=self.schema) + "\n".join(self.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"

    def write(self, path):
        path.write_text(self.text(), encoding="utf-8")
        return path


def steps(ifc, start, direction, z, *, width, going, riser, count):
    """Return solids of treads: a flight from the middle of its lower edge, in a direction along x or y."""
    (x, y), (dx, dy) = start, direction
    solids = []
    for k in range(count):
        a, b = k * going, (k + 1) * going
        corners = [
            (x + dx * s - dy * w, y + dy * s + dx * w)
            for s, w in ((a, -width / 2), (b, -width / 2), (b, width / 2), (a, width / 2))
        ]
        solids.append(ifc.extruded(corners, z + k * riser, riser))
    return solids


REGISTRY = Registry(builtins=built_in("importer"))


class Here:
    """What reads products in this process; tests/building/test_products.py has the other process."""

    def __init__(self, workers, first, arguments, **options):
        first(*arguments)

    def submit(self, function, *arguments):
        answer = Future()
        answer.set_result(function(*arguments))
        return answer

    def kill(self):
        pass


@pytest.fixture
def here(monkeypatch):
    """Read products in this process; processes that are started for anything else, such as kernels, are real."""

    def pool(workers, *given, **options):
        return Here(workers, *given, **options) if given else Pool(workers, **options)

    monkeypatch.setattr("evac.base.processes.Pool", pool)


def plan_of(path, **parameters):
    return REGISTRY.importer_for(path)(**parameters).read(path)


def building_of(path, **parameters):
    return plan_of(path, **parameters).building(need_exit=False)


def walls(ifc, z, height=3.0):
    """Add outer walls of 0.2 m around 10 x 6 m, and one between two rooms at x = 5."""
    boxes = [((0, 0), (10.4, 0.2)), ((0, 6.2), (10.4, 6.4)), ((0, 0.2), (0.2, 6.2)), ((10.2, 0.2), (10.4, 6.2))]
    boxes.append(((5.1, 0.2), (5.3, 6.2)))
    return [ifc.box("IFCWALL", f"W{k}", (*low, z), (*high, z + height)) for k, (low, high) in enumerate(boxes)]


def house(ifc, *, storeys=1, spaces=True, hole=None):
    """Add two rooms on each storey, a door between them, and a front door on the ground floor."""
    for k in range(storeys):
        z = 3.0 * k
        ifc.storey(f"L{k}", z)
        slab = ifc.box("IFCSLAB", "S", (0, 0, z - 0.2), (10.4, 6.4, z), predefined="FLOOR")
        if hole and (k or storeys == 1):
            ifc.opening((hole[0], hole[1], z - 0.3), (hole[2], hole[3], z + 0.1), wall=slab)
        made = walls(ifc, z)
        ifc.opening((5.1, 1, z), (5.3, 2, z + 2.1), wall=made[4], door="inner")
        ifc.opening((2, 6.2, z + 0.9), (4, 6.4, z + 2.1), wall=made[1], window="pane")
        if not k:
            ifc.opening((0, 3, z), (0.2, 4.2, z + 2.1), wall=made[2], door="front")
        if spaces:
            ifc.space(f"{k}01", [(0.2, 0.2), (5.1, 0.2), (5.1, 6.2), (0.2, 6.2)], z)
            ifc.space(f"{k}02", [(5.3, 0.2), (10.2, 0.2), (10.2, 6.2), (5.3, 6.2)], z)
    return ifc


STRAIGHT = {"width": 1.2, "going": 0.28, "riser": 3.0 / 17, "count": 16}


STAIR_TAIL = {"IFCSTAIRFLIGHT": ",$,17,16,0.17,0.28,.STRAIGHT.", "IFCSTAIR": ",$,.STRAIGHT_RUN_STAIR."}


def all_out(path, folder, people=20, spacing=0.2):
    """Return whether everybody on all storeys of an imported file gets out."""
    made = evac.import_building([path], folder / "case", people=people)
    assert made.fault == ""
    results = evac.run(evac.load(made.folder, {"directions.spacing": spacing}), progress=False)
    return results.evacuated == people and len({room.level for room in made.rooms}) > 1


def u_shaped(ifc, kind="IFCSTAIR", landing="own"):
    """Add a stair of two flights of eight treads and a half landing, in one body or with a slab."""
    options = {"width": 1.2, "going": 0.28, "riser": 3.0 / 18, "count": 8}
    first = steps(ifc, (6.5, 1.2), (1, 0), 0.0, **options)
    second = steps(ifc, (6.5 + 8 * 0.28, 2.5), (-1, 0), 1.5, **options)
    low = (6.5 + 8 * 0.28, 0.6)
    outline = [low, (low[0] + 1.2, 0.6), (low[0] + 1.2, 3.1), (low[0], 3.1)]
    if landing == "own":
        ifc.body(kind, "U", *first, *second, ifc.extruded(outline, 1.4, 0.1), tail=STAIR_TAIL[kind])
    else:
        ifc.body("IFCSTAIRFLIGHT", "first", *first, tail=STAIR_TAIL["IFCSTAIRFLIGHT"])
        ifc.body("IFCSTAIRFLIGHT", "second", *second, tail=STAIR_TAIL["IFCSTAIRFLIGHT"])
        ifc.body("IFCSLAB", "half", ifc.extruded(outline, 1.4, 0.1), predefined=landing)
    return ifc


U_HOLE = (6.5, 0.6, 9.95, 3.1)


def slabs(ifc, hole):
    for k in range(2):
        ifc.storey(f"L{k}", 3.0 * k)
        slab = ifc.box("IFCSLAB", "S", (0, 0, 3 * k - 0.2), (12, 8, 3 * k), predefined="FLOOR")
    ifc.opening((*hole[:2], 2.7), (*hole[2:], 3.1), wall=slab)
    return ifc


def told_by(path, *kinds, **parameters):
    plan = plan_of(path, **parameters)
    plan.building(need_exit=False)
    return [(one.level, one.place, one.text) for one in plan.findings if one.kind in kinds]
