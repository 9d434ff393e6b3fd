"""Scenes of planar: schema, checks, construction, records and figures."""
