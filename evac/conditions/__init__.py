"""Conditions of the air: smoke, gases and heat at people's heads, the dose that they take, and how fast they walk."""
