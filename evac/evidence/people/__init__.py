"""Comparison of simulated people with experiments, for each movement model and contact model."""
