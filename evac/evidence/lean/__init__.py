"""Lean: what leaving out saves what a scene does not need."""
