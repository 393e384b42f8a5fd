"""Travel times by marches: one field through all levels, and routes again during a run."""
