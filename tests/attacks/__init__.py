"""Random bad input and random runs; `-m "slow or not slow"` draws ten times as many cases."""
