"""Maps from the parameters of a wave to speed and turning, fitted to short runs of the plant."""
