"""What is asked of signals."""
