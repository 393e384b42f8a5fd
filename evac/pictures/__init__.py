"""Pictures, films and maps of buildings and people.

`render.py` draws a building once, to a `View`: a picture, the depth of each pixel, and a projection. `scene.py` makes
one in three dimensions with VTK, `planview.py` one in plan with matplotlib. `pawns.py` then draws people into it for
each frame, without VTK. `floorplan.py` draws the plans of storeys for plan views and maps.
"""
