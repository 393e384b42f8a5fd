"""What every room uses: errors, arrays, declared parameters, distributions, processes, progress."""
