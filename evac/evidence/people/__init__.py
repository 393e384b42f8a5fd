"""People as measured: simulated people beside people in laboratories, with each movement model and contact model."""
