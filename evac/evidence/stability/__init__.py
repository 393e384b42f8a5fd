"""Stability: stiff and extreme cases, cell by cell, beside the theory."""
