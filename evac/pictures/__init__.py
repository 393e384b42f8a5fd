"""Pictures, films and maps of buildings and people.

`render.py` draws a building once, to a `View`: a picture, the depth of each pixel, and a projection. `model3d.py`
makes one in three dimensions with VTK, `floorplan.py` one in plan with matplotlib, and plans for maps. People are drawn
into it for each frame, without VTK.
"""
