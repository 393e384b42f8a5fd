"""Examples of hypothesis: ten times as many with `pytest tests/properties --hypothesis-profile=thorough`."""

from hypothesis import settings

settings.register_profile("thorough", max_examples=1000)
