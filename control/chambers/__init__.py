"""Commands to chambers and hinges that, in addition to the wave of a gait, bend the body along its path."""
