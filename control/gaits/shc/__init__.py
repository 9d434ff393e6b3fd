"""Stable heteroclinic channels: cycles of saddles that noise and feedback pace, and the gait that they make."""
