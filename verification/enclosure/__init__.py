"""Rigorous bounds of CasADi Functions on boxes."""
