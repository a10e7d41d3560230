"""Data that every room speaks of: laws, studies, claims, verdicts, settings."""
