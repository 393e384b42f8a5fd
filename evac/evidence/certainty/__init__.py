"""Uncertainty of studies: coverage of intervals, required numbers of runs, and the benefit of common seeds."""
