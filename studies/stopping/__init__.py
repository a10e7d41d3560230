"""Tube predictive control of a braking train."""
