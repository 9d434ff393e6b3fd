"""Networks of neurons as gaits, and what real larvae tell about them."""
