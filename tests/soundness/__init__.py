"""Random small plants and laws whose truth is known by construction, on which every general claim is asked."""
