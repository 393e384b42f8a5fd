"""Accuracy: error against run time, all alternatives in one run on the same problems."""
