"""Lean: time saved by leaving out parts that a scene does not need."""
