"""Small cases that use many features at once, for which every output of a run is checked against the others."""

HOUSE = {
    "storeys": [
        {"name": "hall", "polygons": [[[0, 0], [8, 0], [8, 8], [0, 8]], [[8.2, 0], [14, 0], [14, 8], [8.2, 8]]]},
        {"name": "gallery", "z": 3.0, "polygons": [[[0, 0], [14, 0], [14, 8], [0, 8]]]},
    ],
    "doors": [{"name": "inner", "storey": "hall", "segment": [[8.1, 3], [8.1, 4.2]]}],
    "stairs": [
        {
            **{"name": "north", "lower": "hall", "lower_edge": [[1, 0.8], [1, 2.2]], "upper": "gallery"},
            **{"length": 5.5, "direction": [1, 0]},
        },
        {
            **{"name": "south", "lower": "hall", "lower_edge": [[1, 6.4], [1, 7.6]], "upper": "gallery"},
            **{"length": 5.5, "direction": [1, 0]},
        },
    ],
    "exits": [
        {"name": "main", "storey": "hall", "segment": [[0, 3.5], [0, 4.7]]},
        {"name": "back", "storey": "hall", "segment": [[14, 3.5], [14, 4.5]]},
        {"name": "bridge", "storey": "gallery", "segment": [[14, 3], [14, 4]]},
    ],
    "areas": [
        {"name": "loft", "storey": "gallery", "polygon": [[8, 1], [13, 1], [13, 7], [8, 7]]},
        {"name": "room", "storey": "hall", "polygon": [[9, 1], [13, 1], [13, 7], [9, 7]]},
        {"name": "yard", "storey": "hall", "polygon": [[2, 3], [7, 3], [7, 5.5], [2, 5.5]]},
        {"name": "corner", "storey": "gallery", "polygon": [[9, 5], [13, 5], [13, 7.8], [9, 7.8]]},
    ],
}
LINES = [
    {"name": "middle", "level": "hall", "segment": [[3, 0.1], [3, 7.8]]},
    {"name": "above", "level": "gallery", "segment": [[8, 7.9], [8, 0.1]]},
]
CROWD = {
    **{"radius": {"uniform": [0.2, 0.25]}, "speed": {"uniform": [1.0, 1.6]}},
    **{"speed_up": {"uniform": [0.5, 0.6]}, "speed_down": {"uniform": [0.8, 0.9]}},
}
COMMON = {"building": {"plan": HOUSE}, "line": LINES, "output": {"picture": False}}

JOURNEYS = {
    # Response times, exits that close and open, a stair and a door of one direction, slow people, people who go up.
    "events": {
        **{"title": "Doors close & open", **COMMON, "simulation": {"duration": 60.0}},
        **{"contact": {"model": "nsm2"}, "behaviours": {"response_time": {"time": {"uniform": [0.0, 3.0]}}}},
        "people": [
            {"name": "quick", "number": 18, "area": "room", "strategy": "quickest", **CROWD},
            {"name": "late", "number": 12, "area": "loft", "exits": ["main", "back"], **CROWD},
            {"name": "up", "number": 4, "area": "yard", "exits": ["bridge"], **CROWD},
        ],
        "directions": {"spacing": 0.2},
        "event": [
            {"time": 2.0, "kind": "close", "target": "back"},
            {"name": "some", "when": {"out": 1}, "kind": "slow", "target": "room", "value": 0.7},
            {"when": {"event": "some", "after": 4.0}, "kind": "open", "target": "back"},
            {"time": 3.0, "kind": "one_way", "target": "south", "value": "down"},
            {"time": 3.5, "kind": "one_way", "target": "inner", "value": "yard"},
            {"time": 4.0, "kind": "bar", "target": "corner"},
            {"time": 1.0, "kind": "alarm", "target": "loft", "value": 0.5},
        ],
    },
    # People who come through an exit, a stair and a lift, staff who stay, people who know one exit or two.
    "arrivals": {
        **{"title": "A platform", **COMMON, "simulation": {"duration": 40.0}, "contact": {"model": "dem"}},
        "people": [
            {"name": "guests", "number": 12, "area": "loft", **CROWD},
            {"name": "train", "level": "hall", "arrive": {"rate": 1.0, "from": 1.0, "to": 12.0}, **CROWD},
            {"name": "visitors", "arrive": {"times": [1.0, 1.0, 4.0], "exit": "back"}, "exits": ["main"], **CROWD},
            {"name": "below", "level": "hall", "arrive": {"times": [2.0, 50.0], "portal": "north"}, **CROWD},
            {"name": "staff", "number": 3, "area": "room", "leave": False, **CROWD},
        ],
        "behaviours": {"walking": {}, "familiarity": {"main": ["main"], "knows": {"back": 0.5}}},
    },
    # A class that is counted, guests at an assembly area, a wheelchair in a refuge, a patient who is fetched.
    "places": {
        **{"title": "A class gathers", **COMMON, "simulation": {"duration": 70.0}, "contact": {"model": "nsm2"}},
        "place": [
            {"name": "safe", "kind": "assembly", "area": "loft", "capacity": 3},
            {"name": "lobby", "kind": "refuge", "area": "corner", "capacity": 1},
        ],
        "people": [
            {
                "name": "teacher",
                "number": 1,
                "area": "room",
                "behaviours": {"together": {"unit": "a", "gather": "yard"}},
            },
            {
                **{"name": "class", "number": 9, "area": "room", **CROWD},
                "behaviours": {
                    "together": {"unit": "a", "gather": "yard"},
                    "teacher_following": {"teacher": "teacher"},
                },
            },
            {"name": "guests", "number": 5, "area": "room", "assembly": ["safe"], **CROWD},
            {"name": "wheelchair", "preset": "wheelchair", "number": 1, "area": "loft", "exits": ["main"]},
            {"name": "patient", "number": 1, "area": "loft", "behaviours": {"helpers": {"device": "evacuation_chair"}}},
            {"name": "helper", "number": 1, "area": "yard", "behaviours": {"helpers": {"fetches": "patient"}}},
        ],
        "behaviours": {
            "walking": {},
            "together": {"places": ["yard"], "count": 3.0},
            "teacher_following": {},
            "helpers": {"areas": ["loft"], "preparation": 2.0},
        },
    },
    # Smoke that slows people but children below it, gases that stop one person, a group that is sent to another exit.
    "fire": {
        **{"title": "Smoke", **COMMON, "simulation": {"duration": 40.0}, "contact": {"model": "nsm1"}},
        "people": [
            {"name": "adults", "number": 8, "area": "room", "height": 1.8, "exits": ["main"], **CROWD},
            {"name": "children", "number": 4, "area": "yard", "height": 1.0, **CROWD},
            {"name": "above", "number": 6, "area": "loft", **CROWD},
            {"name": "asleep", "number": 1, "area": "corner", "behaviours": {"response_time": {"time": 30.0}}},
        ],
        "behaviours": {"response_time": {"time": {"uniform": [0.0, 2.0]}}, "walking": {}},
        "conditions": [
            {
                **{"source": "prescribed", "level": "hall", "above": 1.2, "times": [0.0, 20.0], "hold": True},
                "values": {"extinction": [0.0, 2.0], "co": 500.0, "co2": 1.0, "o2": 20.0},
            },
            {
                **{"source": "prescribed", "area": "corner"},
                "values": {"extinction": 1.0, "co": 40000.0, "co2": 1.0, "o2": 15.0},
            },
        ],
        "dose": {"heat": "none", "threshold": 0.5},
        "event": [{"time": 4.0, "kind": "strategy", "target": "above", "value": ["main"]}],
    },
}

#: Shipped cases, which take longer.
SHIPPED = {"school": "primary_school", "office": "office_fire"}
