"""Data of a run: series, energy ledger, states, status and estimated errors."""
