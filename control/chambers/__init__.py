"""Commands to chambers and hinges in addition to the wave of a gait, with which the body bends along its path."""
