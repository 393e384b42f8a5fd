"""Studies: many runs of one or several cases, with statistics and their uncertainty."""
