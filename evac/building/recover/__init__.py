"""Plans recovered from what was drawn for other purposes: lines of walls, solids of building models."""
