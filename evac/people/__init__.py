"""People: named distributions, placement, and the arrays of everybody."""
