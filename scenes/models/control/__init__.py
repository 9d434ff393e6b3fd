"""The model `worm_control`, a worm with a controller: schema, checks, construction, records and figures."""
