"""Threads that share the phases of a step, with identical results for any number of them."""
