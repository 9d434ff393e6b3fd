"""The models `planar_published` and `planar_linkage`: schema, checks, construction, records and figures."""
