"""Studies: swept scenes, each with a question, and lessons for a designer from the numbers."""
