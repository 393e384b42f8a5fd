"""The report of a run or of a study: one HTML file that prints well and holds what a documentation has to hold."""
