"""The browser of the tests of the replay."""

from tests.replay.conftest import browser, chromium

__all__ = ["browser", "chromium"]
