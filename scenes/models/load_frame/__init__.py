"""Scenes of load_frame: schema, run and figures."""
