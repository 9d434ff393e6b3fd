"""`worm3d study`: sweeps that answer a question, with sentences that tell a designer what the numbers mean."""
