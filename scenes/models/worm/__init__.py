"""Scenes of worm: schema, checks, construction, records and figures."""
