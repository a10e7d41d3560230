"""Every law on one plant, tuned alike."""
