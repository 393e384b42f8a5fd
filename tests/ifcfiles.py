"""Small IFC files, written for tests: storeys, and bodies that are extruded or have faces of their own."""

import itertools

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
