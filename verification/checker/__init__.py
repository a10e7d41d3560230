"""Re-checks certificates: python-flint and the standard library, nothing of the program that wrote them."""
