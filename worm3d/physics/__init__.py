"""The equations of the worm and its contact, symbolic, and the kernels that are generated from them."""
