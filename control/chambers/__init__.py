"""Commands of chambers and hinges beside the wave of a gait: bodies that bend along their path."""
