"""`worm3d study paper`: the paper's tables, figures and claims from our own runs."""
