"""The command line of `worm3d`: arguments and help. Each command calls other packages of `scenes` to do its work."""
