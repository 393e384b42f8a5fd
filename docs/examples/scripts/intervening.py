"""Sends people in a part of an office to another exit, takes one out, and lets a guest come in, after a second."""

import evac

office = evac.Plan()
office.storey("office", [(0, 0), (12, 0), (12, 6), (0, 6)])
office.exit("west", "office", [(0, 2), (0, 4)])
office.exit("east", "office", [(12, 2), (12, 4)])
office.area("desks", "office", [(2, 1), (10, 1), (10, 5), (2, 5)])
staff = {"name": "staff", "area": "desks", "number": 20, "exits": ["east"]}
guests = {"name": "guests", "area": "desks", "arrive": {"reserve": 5}}
day = evac.load(
    {"building": office, "people": [staff, guests], "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}}
)
to_west = evac.Route(exits=("west",))
stepped = evac.Simulation(day, routes=[to_west])
while not stepped.ended:
    if stepped.step == 100:
        stepped.scene.send(stepped.scene.people_in([(0, 0), (5, 0), (5, 6), (0, 6)]), to_west)
        stepped.scene.remove([0])
        guest = stepped.scene.add("guests", (11.0, 1.0))
    stepped.advance_tick()
results = stepped.results()
guest_out, by_west = results.crowd.exit_time[guest], results.exits["west"]["people"]
print(f"{results.evacuated} out, {by_west} by west; the guest after {guest_out:.1f} s")
