"""Slips planted in the program, and the checks that must turn red."""
