"""Stable heteroclinic channels: cycles of saddles, paced by noise and feedback, and the gait of such a cycle."""
