"""Ratios against what a user would write or pick instead, all measured in one run: ``make bench``."""
