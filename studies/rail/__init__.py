"""The vocabulary of trains: what several studies measure of a ride."""
