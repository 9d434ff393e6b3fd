"""Excitatory-inhibitory network of a fly's larva, with waves driven by felt contraction, and the larva's mechanics."""
