"""What is proved of laws, and what its proofs need."""
