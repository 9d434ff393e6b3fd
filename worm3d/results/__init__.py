"""Results as data: measured, kept in files and drawn. `worm3d.running`, above this room, makes them."""
