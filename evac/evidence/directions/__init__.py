"""Directions: travel times and directions of both solvers against exact paths."""
