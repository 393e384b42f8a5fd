"""Measures the density before a door, and the people who pass it, with PedPy."""

import pedpy

import evac

case = evac.load("classroom").change({"output.every": 0.1, "output.animation": False})
evac.run(case, "pedpy-result")
trajectory = evac.read_trajectory("pedpy-result")
motion, area = trajectory.to_pedpy("classroom")

cells = pedpy.compute_individual_voronoi_polygons(traj_data=motion, walkable_area=area)
before_the_door = pedpy.MeasurementArea([(4.3, 0.3), (5.8, 0.3), (5.8, 1.3), (4.3, 1.3)])
density, _ = pedpy.compute_voronoi_density(individual_voronoi_data=cells, measurement_area=before_the_door)
print("maximum density before the door:", density.density.max(), "people per square metre")

line = pedpy.MeasurementLine([(4.9, 0.0), (5.85, 0.9)])
passed, crossings = pedpy.compute_n_t(traj_data=motion, measurement_line=line)
print(passed.cumulative_pedestrians.max(), "people passed the line around the door")
