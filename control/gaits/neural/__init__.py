"""Networks of neurons as gaits, and the data of real larvae on them."""
