"""What several laws are made of."""
