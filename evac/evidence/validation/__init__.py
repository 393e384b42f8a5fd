"""Validation: the standard tests of the field, put to every contact model."""
