"""Tuning laws alike, and comparing them."""
