"""From a surface mesh to a building: welding, levels, links, checks; and surfaces of foreign meshes."""
