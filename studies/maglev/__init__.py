"""Periodic adaptive learning control of a maglev shuttle."""
