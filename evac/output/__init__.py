"""Output: recorders, the trajectory file, results, VTK files and pictures."""
