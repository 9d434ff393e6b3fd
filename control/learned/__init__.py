"""A learned controller: what it senses, its network, and the loop around it; `scenes.studies.learn` trains it."""
