"""People: distributions of their properties, placement, and the population."""
