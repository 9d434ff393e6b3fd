"""Results as data: measured, kept in files and drawn. `worm3d.running`, a layer above, creates results."""
