"""Networks of neurons as gaits, and their training with recordings of real larvae."""
