"""The language of scene files: read, checked, overridden and explained; nothing here knows of worms."""
