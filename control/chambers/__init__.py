"""What chambers and hinges do beside the wave of a gait: bodies that bend along their path."""
