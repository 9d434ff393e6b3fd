"""The language of scene files: parsing, checks, overrides and explanations, without any knowledge of worms."""
