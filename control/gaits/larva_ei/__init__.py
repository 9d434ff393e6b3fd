"""Network of a fly larva with excitation and inhibition, driven by felt contraction, and the larva's mechanics."""
