"""A converter: rooms, doors and people of another program's JSON become a plan file and a case, its result a CSV."""

import json
import sys
from pathlib import Path

import shapely

import evac

EXAMPLE = {
    "rooms": [{"id": "office", "x": 0, "y": 0, "w": 5, "h": 4}, {"id": "corridor", "x": 5, "y": 0, "w": 2, "h": 8}],
    "doors": [{"between": ["office", "corridor"], "at": [5, 2], "width": 1.0}],
    "exits": [{"id": "out", "from": [5, 8], "to": [7, 8]}],
    "people": {"office": 6},
}


def converted(data):
    """Return the plan and the groups of people."""
    plan, rooms = evac.Plan(), {}
    for room in data["rooms"]:
        rooms[room["id"]] = shapely.box(room["x"], room["y"], room["x"] + room["w"], room["y"] + room["h"])
    walls = []
    for door in data["doors"]:
        first, second = (rooms[name] for name in door["between"])
        opening = shapely.Point(door["at"]).buffer(door["width"] / 2, cap_style="square")
        walls.append(first.intersection(second).difference(opening).buffer(0.05, cap_style="flat"))
    plan.storey("ground", shapely.union_all([*rooms.values()]).difference(shapely.union_all(walls)))
    for name, shape in rooms.items():
        plan.area(name, "ground", shape.buffer(-0.3))
    for way in data["exits"]:
        plan.exit(way["id"], "ground", [way["from"], way["to"]])
    people = [{"name": f"in {room}", "area": room, "number": count} for room, count in data["people"].items()]
    return plan, people


def main(source, folder):
    """Write plan and case to a folder, run the case, and write who was where when."""
    plan, people = converted(json.loads(Path(source).read_text(encoding="utf-8")))
    folder.mkdir(exist_ok=True)
    plan.write(folder / "house.plan.toml")
    building = {"mesh": str(folder.resolve() / "house.plan.toml")}
    table = {"building": building, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}}
    case = evac.load(table)
    case.write(folder / "case.toml")
    evac.run(case).trajectory.frame.to_csv(folder / "motion.csv", index=False)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        Path("rooms.json").write_text(json.dumps(EXAMPLE), encoding="utf-8")
    main(sys.argv[1] if len(sys.argv) > 1 else "rooms.json", Path("converted"))
