"""Model predictive control of the parameters of a gait."""
