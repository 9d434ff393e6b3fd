"""Climbing where walls close round the worm: what tells that they do, the gait, its pace, and the controller."""
