"""Results of a run, how it ended, and quality warnings."""
