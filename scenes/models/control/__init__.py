"""Scenes of control: schema, checks, construction, records and figures."""
