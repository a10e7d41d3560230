"""Fuzzy immune PID whose weights a network tunes."""
