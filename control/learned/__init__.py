"""A learned controller: its observation, its network, and the control loop. `scenes.studies.learn` trains it."""
