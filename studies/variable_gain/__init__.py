"""ILC with variable gain and initial-state learning."""
