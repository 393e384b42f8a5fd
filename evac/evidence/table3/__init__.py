"""Table 3 of the paper, and the figures, the classroom and the school around it."""
