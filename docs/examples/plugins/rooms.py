"""Reads plans drawn as text: a line for each room, table and exit of one storey."""

from shapely import box

from evac import Importer, Parameter, Plan


class RoomsImporter(Importer):
    """Lines `room hall 0 0 8 4` and `table desk 2 2 3 3` (two corners), and `exit door 0 1 0 2` (two ends)."""

    name = "rooms"
    suffixes = (".rooms",)

    unit = Parameter(1.0, "metres per unit of the file", unit="m", above=0.0)

    def read(self, path):
        """Return the plan; raise ValueError that names the line if one is wrong."""
        plan, rooms = Plan(path), []
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                kind, name, *numbers = line.split()
                x1, y1, x2, y2 = (self.unit * float(value) for value in numbers)
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from error
            if kind == "exit":
                plan.exit(name, "floor", [(x1, y1), (x2, y2)])
            elif kind == "table":
                plan.obstacle(name, "floor", box(x1, y1, x2, y2))
            elif kind == "room":
                rooms.append(box(x1, y1, x2, y2))
                plan.area(name, "floor", rooms[-1])
            else:
                plan.note("left out", f"line {number}: a {kind} is not known", "floor", (x1, y1))
        plan.storey("floor", rooms)
        return plan


evac_interface = 3
