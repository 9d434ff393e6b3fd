"""`worm3d paper`: the paper's tables, figures and claims from our own runs."""
