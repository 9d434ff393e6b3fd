"""Learning controllers: episodes of worms in scenes, many at once, and the training of a policy."""
