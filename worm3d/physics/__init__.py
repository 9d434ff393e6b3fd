"""The symbolic equations of the worm and of contact, and the kernels generated from these equations."""
