"""Time of a person-step beside other programs, each of which is optional."""
