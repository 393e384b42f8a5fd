"""The replay: a run as a single self-contained HTML page."""
