"""What a run leaves: its series, its energy ledger, the state at its end, how it ended, and how far it may be off."""
