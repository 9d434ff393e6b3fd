"""The language of scene files: parsing, checks, overrides and error messages. This package knows nothing of worms."""
