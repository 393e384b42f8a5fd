"""Contacts: search, rows of the contact problem, base classes of contact models, stability."""
