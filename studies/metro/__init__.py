"""Model-free adaptive ILC of a metro train."""
