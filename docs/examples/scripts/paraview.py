"""Draws people as bodies from the animation of a run, classroom-result, with PyVista."""

import pyvista

reader = pyvista.get_reader("classroom-result/animation.pvd")
reader.set_active_time_value(reader.time_values[10])
people, building = reader.read()
trunk = pyvista.Cylinder(center=(0, 0, 3), direction=(0, 0, 1), radius=1, height=6)
body = pyvista.merge([trunk, pyvista.Sphere(radius=0.7, center=(0, 0, 6.7))])
plotter = pyvista.Plotter(off_screen=True)  # False opens a window, with plotter.show() as the last line
looks = {"levels": {"opacity": 0.4}, "walls": {"color": "gray"}, "exits": {"color": "green", "line_width": 6}}
for block, look in looks.items():
    for part in building[block]:
        plotter.add_mesh(part, **look)
plotter.add_mesh(people.glyph(geom=body, scale="radius", orient=False), scalars="speed")
plotter.screenshot("people.png")
