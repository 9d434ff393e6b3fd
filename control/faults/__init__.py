"""Faults: the watch that tells them from measurements, which the loop asks, and faults put in on purpose (`injected`)."""
