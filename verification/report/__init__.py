"""HTML, JSON and JUnit XML from verdicts; nothing is computed here."""
