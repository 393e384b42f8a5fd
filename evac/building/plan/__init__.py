"""Plans: storeys, stairs, doors and exits in plan, and the surface mesh that is drawn from them."""
