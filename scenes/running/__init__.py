"""Running a scene: its progress, the report on the terminal, and pictures of the result."""
