"""Estimation of place, heading and drift from measurements, and the reduced model that planners share."""
