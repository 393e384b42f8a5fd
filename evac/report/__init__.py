"""The report of a run or of a study: one HTML file to print, with all that the documentation of a simulation needs.

Each section is a function that computes rows and pictures (`sections.py`) and a template with the words
(`sections.html`), in which every value is escaped. All pages extend `frame.html`. `evidence.json` has the verdicts
on the standard tests, which `evac evidence` writes.
"""
