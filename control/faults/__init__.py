"""Faults: the watch, which detects faults from measurements, and faults injected on purpose (`injected`)."""
