"""Estimation of position, heading and motion from measurements, and the reduced model that planners also use."""
