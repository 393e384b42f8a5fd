"""Travel times by fast marching: one field through all levels, or several at the same time in processes."""
