"""Travel times by marches: one field through all levels, several in processes, and routes again during a run."""
