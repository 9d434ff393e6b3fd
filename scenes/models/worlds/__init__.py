"""Scenes of worlds: schema, checks, construction, records and figures."""
