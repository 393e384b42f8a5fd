"""The trajectory file: its format, writing and reading; calling of recorders."""
