"""The corridor of NIST 2.5 and ISO 18, 100 m by 2 m, rooms in which people stand in gases, and two storeys."""

import evac


def corridor(*conditions, speed=1.25, positions=((0.5, 1.0),), **tables):
    """Return a case of people who walk through the corridor, with tables of conditions."""
    outline = [[0, 0], [100, 0], [100, 2], [0, 2]]
    exits = [{"name": "out", "storey": "f", "segment": [[100, 0], [100, 2]]}]
    people = {"name": "p", "level": "f", "positions": [list(one) for one in positions], "speed": speed, "tau": 0.2}
    table = {
        "building": {"plan": {"storeys": [{"name": "f", "polygons": [outline]}], "exits": exits}},
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 3000.0},
        "people": [{**people, "radius": 0.2, "height": 1.7}],
        "conditions": list(conditions),
        "smoke": {"routes": False},
        "directions": {"spacing": 0.25},
    }
    return evac.load({**table, **tables})


def prescribed(extinction=None, **more):
    """Return a table of conditions that are prescribed."""
    values = {} if extinction is None else {"extinction": extinction}
    return {"source": "prescribed", "values": values | more.pop("values", {}), **more}


def standing(dose=None, people=1, **values):
    """Return a case of people who stand in gases."""
    places = [[0.4 + 0.35 * (k % 280), 0.4 + 0.4 * (k // 280)] for k in range(people)]
    group = {"name": "p", "level": "f", "positions": places, "radius": 0.1, "leave": False}
    tables = {"people": [group], "smoke": {"law": "none"}, "dose": {"heat": "none", **(dose or {})}}
    return corridor({"source": "prescribed", "values": values}, **tables)


def two_storeys():
    """Return the plan of two storeys of one room each, with a stair and an exit below."""
    room = [[0, 0], [12, 0], [12, 8], [0, 8]]
    stair = {"name": "stair", "lower": "down", "lower_edge": [[4, 1.2], [4, 2.7]], "upper": "up", "length": 5.0}
    return {
        "storeys": [{"name": name, "z": z, "polygons": [room]} for name, z in (("down", 0.0), ("up", 3.0))],
        "stairs": [{**stair, "direction": [1, 0]}],
        "exits": [{"name": "out", "storey": "down", "segment": [[0, 3], [0, 5]]}],
    }
