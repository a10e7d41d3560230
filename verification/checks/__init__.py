"""Methods that look at one claim, one idea a file."""
