"""How sure the results of studies are: what intervals cover, how many runs questions need, what common seeds save."""
