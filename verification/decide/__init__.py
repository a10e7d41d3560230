"""Whoever needs a verdict."""
