"""`worm3d study validate`: compares the models with closed forms, and with measurements on robots and animals."""
