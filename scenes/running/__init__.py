"""Running a scene: what a person sees of it, and its pictures."""
