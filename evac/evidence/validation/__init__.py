"""Validation: the standard tests of the field for every contact model."""
