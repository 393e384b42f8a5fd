"""Properties that hold for random buildings, cases, files and runs, which hypothesis draws."""
