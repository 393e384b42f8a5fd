"""Closes the upper stair of the school from 10 s to 40 s, and writes the results."""

import evac

simulation = evac.Simulation("primary_school", "upper-closed")
simulation.scene.apply(evac.Change(10.0, "close", "upper"))
simulation.scene.apply(evac.Change(40.0, "open", "upper"))
results = simulation.run()  # writes the trajectory and the replay
results.write("upper-closed")  # writes the tables and summary.json
print(results.ended, results.changes)
