"""The command line of `worm3d`: arguments and help. The commands themselves run in `sweep`, `studies` and `running`."""
