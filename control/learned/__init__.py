"""A learned controller: its senses, its network, and the loop around it; `scenes.studies.learn` trains it."""
