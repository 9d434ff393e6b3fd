"""Faults: the watch, which tells them from measurements, and faults that are put in on purpose (`injected`)."""
