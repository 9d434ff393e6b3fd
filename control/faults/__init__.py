"""Faults: detection of faults from measurements, and faults that are injected on purpose for tests (`injected`)."""
