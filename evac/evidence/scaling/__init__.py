"""Scaling: time and memory per person-step against the number of people."""
