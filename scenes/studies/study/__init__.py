"""Studies: scenes that are swept, each with a question, and what a designer learns from the numbers."""
