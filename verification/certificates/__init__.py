"""Certificates of what was proved: plain data that :mod:`verification.checker` re-checks."""
