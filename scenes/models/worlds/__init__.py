"""The section [world], which the models of worms share: schema, checks, construction."""
