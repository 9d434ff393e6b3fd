"""The models `worm` and `worm_planar`, worms with a gait: schema, checks, construction, records and figures."""
