"""The building that a run uses: levels, portals, exits, areas, walls, and findings about them."""
