"""Excitatory-inhibitory network of a fly's larva that closes its waves by what its segments feel; its own mechanics."""
