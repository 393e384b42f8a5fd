"""Studies: many runs of a case, or of many cases, and how certain what they say is."""
