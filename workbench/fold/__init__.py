"""A sample, a trial, a campaign: from symbolic equations to machine code."""
