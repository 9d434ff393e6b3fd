"""The model `load_frame`, a segment in a load frame: schema, run and figures."""
